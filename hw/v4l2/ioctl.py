"""The few questions TAMS asks a V4L2 device itself (linux/videodev2.h); v4l2src streams."""

from __future__ import annotations

import errno
import fcntl
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from struct import Struct, pack_into
from typing import Any

_CAPTURES_VIDEO = 0x0000_0001  # V4L2_CAP_VIDEO_CAPTURE
_HAS_OWN_CAPABILITIES = 0x8000_0000  # V4L2_CAP_DEVICE_CAPS
_COMPRESSED = 0x0001  # V4L2_FMT_FLAG_COMPRESSED
_DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE and V4L2_FRMIVAL_TYPE_DISCRETE
_CONTROL_CLASS = 6  # V4L2_CTRL_TYPE_CTRL_CLASS: a heading, not a control
_UNUSABLE = 0x0001 | 0x0004  # V4L2_CTRL_FLAG_DISABLED, _READ_ONLY
_CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
_NEXT_CONTROL = 0x8000_0000  # V4L2_CTRL_FLAG_NEXT_CTRL
_END = (errno.EINVAL, errno.ENOTTY)  # no more of them; none at all
_READ, _READ_WRITE = 2, 3


class _Request(Struct):
    """An ioctl of videodev2.h and the structure it fills."""

    def __init__(self, number: int, layout: str, direction: int = _READ_WRITE) -> None:
        super().__init__(layout)
        self.code = direction << 30 | self.size << 16 | ord("V") << 8 | number  # linux/ioctl.h


# v4l2_capability: driver, card, bus, version, capabilities, those of this node
_QUERYCAP = _Request(0, "16s32s32s3I12x", _READ)
# v4l2_fmtdesc: index, type, flags, description, pixel format, mbus code
_ENUM_FMT = _Request(2, "3I32s2I12x")
# v4l2_control: id, value
_G_CTRL = _Request(27, "Ii")
_S_CTRL = _Request(28, "Ii")
# v4l2_queryctrl: id, type, name, minimum, maximum, step, default, flags
_QUERYCTRL = _Request(36, "2I32s4iI8x")
# v4l2_frmsizeenum: index, pixel format, type; width, height, or smallest, largest, step of each
_ENUM_FRAMESIZES = _Request(74, "3I6I8x")
# v4l2_frmivalenum: index, pixel format, width, height, type; one fraction [s], or shortest,
# longest, step
_ENUM_FRAMEINTERVALS = _Request(75, "5I6I8x")


@dataclass(frozen=True, slots=True)
class Control:
    """A control of a camera, named as v4l2-ctl prints it."""

    id: int
    name: str
    minimum: int
    maximum: int
    default: int


class V4l2Device:
    """An open video node; another process may stream from it. Every call may raise OSError."""

    def __init__(self, node: str) -> None:
        self._fd = os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def __enter__(self) -> V4l2Device:
        return self

    def __exit__(self, *_error: object) -> None:
        os.close(self._fd)

    def card(self) -> tuple[str, bool]:
        """The camera's name, and whether this node captures video."""
        _, card, _, _, capabilities, own = self._ask(_QUERYCAP)
        relevant = own if capabilities & _HAS_OWN_CAPABILITIES else capabilities
        return _text(card), bool(relevant & _CAPTURES_VIDEO)

    def formats(self) -> Iterator[tuple[int, bool]]:
        """The pixel formats it can capture, and whether each is compressed."""
        for _, _, flags, _, pixel_format, _ in self._enumerate(_ENUM_FMT, _CAPTURE):
            yield pixel_format, bool(flags & _COMPRESSED)

    def frame_sizes(self, pixel_format: int) -> Iterator[tuple[int, int, tuple[int, int] | None]]:
        """Width and height [px] of the frames of one format, and up to where if it is a range."""
        for _, _, kind, *size in self._enumerate(_ENUM_FRAMESIZES, pixel_format):
            if kind != _DISCRETE:  # a range stands alone
                yield size[0], size[3], (size[1], size[4])
                return
            yield size[0], size[1], None

    def rates(self, pixel_format: int, width: int, height: int) -> tuple[list[Fraction], bool]:
        """The frame rates [1/s] of one size, and whether any between the two there are will do."""
        rates: list[Fraction] = []
        for found in self._enumerate(_ENUM_FRAMEINTERVALS, pixel_format, width, height):
            kind, shortest, longest = found[4], found[5:7], found[7:9]
            intervals = [shortest] if kind == _DISCRETE else [shortest, longest]
            rates += [Fraction(parts, seconds) for seconds, parts in intervals if seconds and parts]
            if kind != _DISCRETE:
                return rates, True
        return rates, False

    def controls(self) -> Iterator[Control]:
        """Everything that can be set, headings left out."""
        last = 0
        while found := self._next(_QUERYCTRL, last | _NEXT_CONTROL):
            last, kind, title, minimum, maximum, _, default, flags = found
            if kind != _CONTROL_CLASS and not flags & _UNUSABLE:
                yield Control(last, control_name(_text(title)), minimum, maximum, default)

    def control(self, control_id: int) -> int:
        """The present value of a control."""
        return int(self._ask(_G_CTRL, control_id)[1])

    def set_control(self, control_id: int, value: int) -> None:
        """Set a control; drivers may round the value."""
        self._ask(_S_CTRL, control_id, value & 0xFFFF_FFFF)

    def _enumerate(self, request: _Request, *words: int) -> Iterator[tuple[Any, ...]]:
        """The driver's answers to index 0, 1, ..."""
        for index in count():
            found = self._next(request, index, *words)
            if found is None:
                return
            yield found

    def _next(self, request: _Request, *words: int) -> tuple[Any, ...] | None:
        """The answer; None if the enumeration has ended."""
        try:
            return self._ask(request, *words)
        except OSError as error:
            if error.errno in _END:
                return None
            raise

    def _ask(self, request: _Request, *words: int) -> tuple[Any, ...]:
        """The answer to a structure that begins with these words and is 0 from there on."""
        content = bytearray(request.size)
        pack_into(f"{len(words)}I", content, 0, *words)
        fcntl.ioctl(self._fd, request.code, content)
        return request.unpack(content)


def control_name(title: str) -> str:
    """`Exposure Time, Absolute` → `exposure_time_absolute`."""
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode(errors="replace")
