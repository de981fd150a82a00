"""Cameras that are plugged in, their modes, and the choice of the one that is meant.

A V4L2 device is asked as linux/videodev2.h numbers and lays out its questions.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from io import FileIO
from pathlib import Path
from typing import Any

from tams_app.errors import DeviceError

# Number, and layout of the structure that goes there and back.
QUERYCAP = 0, "<16s32s32s6I"  # driver, card, bus, version, capabilities, those of the node
ENUM_FMT = 2, "<3I32s5I"  # index, type, flags, description, fourcc
G_CTRL = 27, "<Ii"  # id, value
S_CTRL = 28, "<Ii"
ENUM_FRAMESIZES = 74, "<11I"  # index, fourcc, kind, width and height or their ranges
ENUM_FRAMEINTERVALS = 75, "<13I"  # index, fourcc, width, height, kind, one or two fractions [s]
QUERY_EXT_CTRL = 103, "<2I32sqqQqI39I"  # id, type, name, minimum, maximum, step, default, flags

_MOST = 128  # answers of a list
_END = (errno.EINVAL, errno.ENOTTY, errno.ENODATA, errno.EPIPE)
MJPEG = ("MJPG", "JPEG")
_LINKS = ("by-id", "by-path")
_RATE_TOLERANCE = 0.01  # 29.97 will do for 30
_CAPTURES = 1  # among the capabilities of a node, and the type of its buffers
_COMPRESSED = 1  # among the flags of a format
_DISCRETE = 1  # kind of a size or rate: not a range


def ask(device: FileIO, question: tuple[int, str], *given: int) -> tuple[Any, ...]:
    """The structure that the driver answers with; `given`: how that of the question begins.

    OSError if it refuses.
    """
    number, layout = question
    size = struct.calcsize(layout)
    direction = 2 if question is QUERYCAP else 3  # read, or written and read
    asked = b"".join((one & 0xFFFF_FFFF).to_bytes(4, "little") for one in given)
    request = direction << 30 | size << 16 | ord("V") << 8 | number
    return struct.unpack(layout, fcntl.ioctl(device, request, asked.ljust(size, b"\0")))


def every(
    device: FileIO,
    question: tuple[int, str],
    *given: int,
    next_flag: int = 0,
) -> Iterator[tuple[Any, ...]]:
    """All answers of a list, whose question begins with an index.

    `next_flag`: the question is instead the number of the last answer with this flag, which asks
    for the one after it.
    """
    index = next_flag
    for _ in range(_MOST):
        try:
            answer = ask(device, question, index, *given)
        except OSError as error:
            if error.errno in _END:
                return
            raise
        yield answer
        index = answer[0] | next_flag if next_flag else answer[0] + 1


@dataclass(frozen=True, slots=True)
class CameraMode:
    """One pixel format (fourcc) at one size and the rates [1/s] it offers, fastest first.

    `largest`: (width, height) up to which any size is offered, None if it is this one alone.
    `any_rate`: everything between the rates; no rates at all: the driver reports none.
    """

    pixel_format: str
    compressed: bool
    width: int
    height: int
    rates: tuple[Fraction, ...]
    any_rate: bool = False
    largest: tuple[int, int] | None = None

    def rate_for(self, width: int, height: int, fps: int) -> Fraction | None:
        """The rate to ask for so that `width` x `height` comes `fps` times a second, or None."""
        widest, highest = self.largest or (self.width, self.height)
        if not (self.width <= width <= widest and self.height <= height <= highest):
            return None
        wanted = Fraction(fps)
        if not self.rates or (self.any_rate and self.rates[-1] <= wanted <= self.rates[0]):
            return wanted
        nearest = min(self.rates, key=lambda rate: abs(rate - wanted))
        return nearest if abs(nearest - wanted) <= _RATE_TOLERANCE * wanted else None

    def __str__(self) -> str:
        size = f"{self.width}x{self.height}"
        if self.largest:
            size = f"{size} to {self.largest[0]}x{self.largest[1]}"
        joint = " to " if self.any_rate else ", "
        rates = joint.join(f"{float(rate):g}" for rate in self.rates) or "unknown rates"
        return f"{self.pixel_format} {size} at {rates}"


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """One video node that captures; `serial` is "" for a camera that has none."""

    name: str
    serial: str
    node: str  # /dev/videoN, as it is numbered now
    links: tuple[str, ...]  # of /dev/v4l, which stay the same
    modes: tuple[CameraMode, ...] = ()
    refusal: str = ""  # why it could not be asked for its modes

    @property
    def paths(self) -> tuple[str, ...]:
        return (self.node, *self.links)

    def __str__(self) -> str:
        serial = f", serial {self.serial}" if self.serial else ""
        refusal = f", {self.refusal}" if self.refusal else ""
        return f"{self.name!r}{serial} at {self.node}{refusal}"


def list_cameras(dev: Path = Path("/dev"), sys: Path = Path("/sys")) -> list[CameraInfo]:
    """The cameras of this machine, in the order of their numbers; nothing is changed in them.

    OSError if one is pulled out at the wrong moment; try again.
    """
    nodes = (sys / "class/video4linux").glob("video*")
    ordered = sorted(nodes, key=lambda node: (len(node.name), node.name))
    links = _links(dev)
    infos = (_camera(dev / node.name, node, links) for node in ordered)
    return [info for info in infos if info is not None]


def choose_camera(
    found: Sequence[CameraInfo],
    name: str = "",
    serial: str = "",
    path: str = "",
) -> CameraInfo:
    """The one camera that has everything of `name`, `serial`, `path` that is given.

    DeviceError, which lists what was found, if none or several have. A path may be a link, such
    as those a laboratory makes by rules of its own.
    """
    wanted = {"name": name, "serial": serial, "path": path}
    matches = [
        info
        for info in found
        if (not name or info.name == name)
        and (not serial or info.serial == serial)
        and (not path or path in info.paths or os.path.realpath(path) == info.node)
    ]
    if len(matches) == 1:
        return matches[0]
    asked = ", ".join(f"{key} {value!r}" for key, value in wanted.items() if value)
    if matches:
        listed = "; ".join(f"{info} ({', '.join(info.links) or info.node})" for info in matches)
        raise DeviceError(f"{len(matches)} cameras have {asked}; tell them apart by path: {listed}")
    listed = "; ".join(map(str, found)) or "no camera at all"
    raise DeviceError(f"no camera has {asked}; plug it in or correct the keys; found: {listed}")


def choose_mode(info: CameraInfo, mjpeg: bool, width: int, height: int, fps: int) -> Fraction:
    """The rate to ask for, compressed or raw; DeviceError, which lists the modes, if none fits."""
    for mode in info.modes:
        if mode.pixel_format in MJPEG if mjpeg else not mode.compressed:
            rate = mode.rate_for(width, height, fps)
            if rate is not None:
                return rate
    kind = "MJPEG" if mjpeg else "raw frames"
    offered = "; ".join(map(str, info.modes)) or info.refusal or "nothing"
    raise DeviceError(
        f"{info} does not offer {kind} of {width}x{height} at {fps}/s; it offers: {offered}"
    )


# --- asking the machine ---------------------------------------------------------------------------


def _links(dev: Path) -> dict[str, list[str]]:
    """The stable links of each node, by what they lead to."""
    links: dict[str, list[str]] = {}
    for folder in _LINKS:
        for link in sorted((dev / "v4l" / folder).glob("*")):
            links.setdefault(os.path.realpath(link), []).append(str(link))
    return links


def _camera(node: Path, sys_node: Path, links: dict[str, list[str]]) -> CameraInfo | None:
    """The facts of one node; None if it does not capture (metadata) or is going away."""
    name = _attribute(sys_node / "name")
    modes: tuple[CameraMode, ...] = ()
    refusal = ""
    try:
        with FileIO(node, "r+") as device:
            _, card, _, _, _, capabilities, *_ = ask(device, QUERYCAP)
            if not capabilities & _CAPTURES:
                return None
            name = name or card.rstrip(b"\0").decode(errors="replace")
            modes = tuple(_modes(device))
    except FileNotFoundError:
        return None
    except PermissionError:
        refusal = "which you may not open: join the group video and log in again"
    except OSError as error:
        refusal = f"which cannot be opened: {error.strerror}"
    linked = links.get(os.path.realpath(node), [])
    return CameraInfo(name, _serial(sys_node), str(node), tuple(linked), modes, refusal)


def _serial(sys_node: Path) -> str:
    """Of the USB device, whose folder lies above that of its interface."""
    interface = (sys_node / "device").resolve()
    return _attribute(interface / "serial") or _attribute(interface.parent / "serial")


def _attribute(file: Path) -> str:
    return file.read_text(errors="replace").strip() if file.is_file() else ""


def _modes(device: FileIO) -> Iterator[CameraMode]:
    for _, _, flags, _, fourcc, *_ in every(device, ENUM_FMT, _CAPTURES):
        name = fourcc.to_bytes(4, "little").decode("latin-1").strip()
        for width, height, largest in _sizes(device, fourcc):
            found, any_rate = _rates(device, fourcc, *(largest or (width, height)))
            rates = tuple(sorted(found, reverse=True))
            compressed = bool(flags & _COMPRESSED)
            yield CameraMode(name, compressed, width, height, rates, any_rate, largest)


def _sizes(device: FileIO, fourcc: int) -> Iterator[tuple[int, int, tuple[int, int] | None]]:
    """Width and height [px] of the frames, and up to where if it is a range."""
    for _, _, kind, *ends in every(device, ENUM_FRAMESIZES, fourcc):
        if kind != _DISCRETE:  # a range stands alone
            narrowest, widest, _, lowest, highest, *_ = ends
            yield narrowest, lowest, (widest, highest)
            return
        yield ends[0], ends[1], None


def _rates(device: FileIO, fourcc: int, width: int, height: int) -> tuple[list[Fraction], bool]:
    """The frame rates [1/s], and whether any between the two there are will do."""
    rates: list[Fraction] = []
    for answer in every(device, ENUM_FRAMEINTERVALS, fourcc, width, height):
        any_rate = answer[4] != _DISCRETE
        periods = (answer[5:7], answer[7:9]) if any_rate else (answer[5:7],)
        rates += [Fraction(parts, seconds) for seconds, parts in periods if seconds and parts]
        if any_rate:
            return rates, True
    return rates, False
