"""V4L2 cameras for a process that has `fake_v4l2.c` preloaded: the kernel's side is played."""

from __future__ import annotations

import ctypes
import mmap
import os
import shutil
import subprocess
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from hw.v4l2 import source as ids
from tams_app.config import VideoConfig

SOURCE = Path(__file__).parent / "fake_v4l2.c"
ROOT = Path(__file__).parents[3]
SMALL = VideoConfig(width=160, height=120)
IMAGES = 8
ROUNDS = 4  # of them, with other noise, before the first one comes again
GREYS = 25  # between the frames
GAIN = 0x0098_0913
INTEGER, BOOLEAN, MENU, HEADING, RECTANGLE = 1, 2, 3, 6, 0x0107
DISABLED, READ_ONLY, HAS_PAYLOAD = 0x0001, 0x0004, 0x0100
SILENT, MARKS = 1, 2  # behaviours


class FakeControl(ctypes.Structure):
    """struct control of fake_v4l2.c"""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("id", "type")),
        ("name", ctypes.c_char * 32),
        *((name, ctypes.c_int32) for name in ("minimum", "maximum", "step", "fallback", "value")),
        *((name, ctypes.c_uint32) for name in ("stubborn", "flags")),
    )


_NUMBERS = (
    "behaviour metadata pixelformat width height rate period widest highest slowest open_error "
    "age_us changes streams_started frame_bytes frame_count control_count"
)


class FakeCamera(ctypes.Structure):
    """struct camera of fake_v4l2.c, shared with the process that has the camera open"""

    _fields_ = (
        ("card", ctypes.c_char * 32),
        *((name, ctypes.c_uint32) for name in _NUMBERS.split()),
        ("controls", FakeControl * 8),
    )

    def values(self) -> dict[str, int]:
        return {one.name.decode(): one.value for one in self.controls if one.name}


WEBCAM_CONTROLS = (
    FakeControl(GAIN, INTEGER, b"Gain", 0, 100, 1, 10, 10),
    FakeControl(ids.EXPOSURE_AUTO, MENU, b"Auto Exposure", 0, 3, 1, 3, 3),
    FakeControl(ids.EXPOSURE_ABSOLUTE, INTEGER, b"Exposure Time, Absolute", 3, 2047, 1, 250, 250),
    FakeControl(ids.EXPOSURE_AUTO_PRIORITY, BOOLEAN, b"Exposure, Dynamic Framerate", 0, 1, 1, 0, 1),
    FakeControl(ids.AUTO_WHITE_BALANCE, BOOLEAN, b"White Balance, Automatic", 0, 1, 1, 1, 1),
    FakeControl(
        ids.WHITE_BALANCE_TEMPERATURE,
        INTEGER,
        b"White Balance Temperature",
        2000,
        6500,
        1,
        4000,
        4000,
    ),
)


def jpegs(video: VideoConfig, rounds: int = 1) -> list[bytes]:
    """Noisy frames whose mean grey tells which of IMAGES it is; padded to one length."""
    rng = np.random.default_rng(5)
    encoded = []
    for number in list(range(IMAGES)) * rounds:
        noise = rng.integers(-4, 5, (video.height, video.width, 3))
        image = np.clip(30 + GREYS * number + noise, 0, 255).astype(np.uint8)
        encoded.append(cv2.imencode(".jpg", image)[1].tobytes())
    longest = max(map(len, encoded))
    return [image.ljust(longest, b"\0") for image in encoded]


class Machine:
    """Folders that look like /dev and /sys to TAMS, with cameras in them."""

    def __init__(self, root: Path) -> None:
        self.dev = root / "dev"
        self.sys = root / "sys"
        self._mapped: list[mmap.mmap] = []
        for folder in (self.dev / "v4l/by-id", self.dev / "v4l/by-path", self.nodes):
            folder.mkdir(parents=True)

    @property
    def nodes(self) -> Path:
        return self.sys / "class/video4linux"

    def node(self, number: int) -> str:
        return str(self.dev / f"video{number}")

    def plug(
        self,
        number: int = 0,
        name: str = "Webcam",
        serial: str = "S1",
        port: int = 1,
        raw: bool = False,
        metadata: bool = False,
        rate: int | Fraction = 30,
        slowest: int = 0,
        video: VideoConfig = SMALL,
        largest: tuple[int, int] = (0, 0),
        controls: Sequence[FakeControl] = WEBCAM_CONTROLS,
        images: Sequence[bytes] | None = None,
    ) -> FakeCamera:
        """Put a camera in, as /dev/video<number> on USB port `port`.

        `slowest`, `largest`: of any rate from there to `rate`, any size from `video` to there.
        `images`: the JPEGs that it gives, all of one length; by default `jpegs`.
        """
        images = jpegs(video, ROUNDS) if images is None else images
        fourcc = int.from_bytes(b"YUYV" if raw else b"MJPG", "little")
        described = FakeCamera(
            card=name.encode(),
            metadata=metadata,
            pixelformat=fourcc,
            width=video.width,
            height=video.height,
            rate=rate.numerator,
            period=rate.denominator,
            widest=largest[0],
            highest=largest[1],
            slowest=slowest,
            frame_bytes=len(images[0]),
            frame_count=len(images),
            control_count=len(controls),
        )
        described.controls[: len(controls)] = list(controls)
        node = Path(self.node(number))
        new = node.with_name("new")
        new.write_bytes(bytes(described) + b"".join(images))
        self._describe(number, name, serial, port)
        new.rename(node)
        with node.open("r+b") as file:
            memory = mmap.mmap(file.fileno(), ctypes.sizeof(FakeCamera))
        self._mapped.append(memory)
        return FakeCamera.from_buffer(memory)

    def unplug(self, number: int = 0) -> None:
        for folder in ("by-id", "by-path"):
            for link in (self.dev / "v4l" / folder).iterdir():
                if os.readlink(link) == self.node(number):
                    link.unlink()
        Path(self.node(number)).unlink()
        shutil.rmtree(self.nodes / f"video{number}")

    def _describe(self, number: int, name: str, serial: str, port: int) -> None:
        usb = self.sys / f"devices/usb1/1-{port}"
        interface = usb / f"1-{port}:1.0"
        interface.mkdir(parents=True, exist_ok=True)
        if serial:
            (usb / "serial").write_text(serial + "\n")
        node = self.nodes / f"video{number}"
        node.mkdir()
        (node / "name").write_text(name + "\n")
        (node / "device").symlink_to(interface)
        for link in (f"by-id/usb-{serial}-video-index0", f"by-path/usb-0:{port}:1.0-video-index0"):
            path = self.dev / "v4l" / link
            if not path.is_symlink():
                path.symlink_to(self.node(number))


def build_library(folder: Path) -> Path:
    """Compile what is preloaded; skips the test where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler to build the played V4L2 device with")
    library = folder / "fake_v4l2.so"
    command = [compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(SOURCE), "-ldl"]
    subprocess.run([*command, "-lpthread"], check=True)
    return library
