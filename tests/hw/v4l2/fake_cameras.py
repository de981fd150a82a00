"""V4L2 cameras that tests plug in and out, and a process in which they seem to be real.

The process runs with `fake_v4l2.c` preloaded, so that everything from v4l2src upwards is the real
thing; what is played is the kernel. Skipped, with the reason, where there is no C compiler.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hw.camera import Camera
from hw.v4l2.controls import (
    AUTO_WHITE_BALANCE,
    EXPOSURE_ABSOLUTE,
    EXPOSURE_AUTO,
    EXPOSURE_AUTO_PRIORITY,
    WHITE_BALANCE_TEMPERATURE,
)
from hw.v4l2.devices import CameraInfo
from tams_app.config import CameraConfig, VideoConfig
from tams_app.errors import ConfigError, DeviceError
from tams_app.records import Frame

SOURCE = Path(__file__).parent / "fake_v4l2.c"
ROOT = Path(__file__).parents[3]
SMALL = VideoConfig(width=160, height=120)
IMAGES = 8
ROUNDS = 4  # of them, with other noise, before the first one comes again
GREYS = 25  # between the frames
GAIN = 0x0098_0913
INTEGER, BOOLEAN, MENU, HEADING, RECTANGLE = 1, 2, 3, 6, 0x0107
DISABLED, READ_ONLY, HAS_PAYLOAD = 0x0001, 0x0004, 0x0100
_ERRORS = {error.__name__: error for error in (ConfigError, DeviceError)}


class Behaviour(IntEnum):
    """What a camera does (fake_v4l2.c)."""

    RUNS = 0
    SILENT = 1
    REPEATS = 2
    SKIPS = 3  # every fifth frame
    CORRUPTS = 4  # all but the beginning of every second frame
    MARKS = 5  # every second frame as one of which something was lost


class FakeControl(ctypes.Structure):
    """struct control of fake_v4l2.c"""

    _fields_ = (
        ("id", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("name", ctypes.c_char * 32),
        ("minimum", ctypes.c_int32),
        ("maximum", ctypes.c_int32),
        ("step", ctypes.c_int32),
        ("fallback", ctypes.c_int32),
        ("value", ctypes.c_int32),
        ("stubborn", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
    )


class FakeCamera(ctypes.Structure):
    """struct camera of fake_v4l2.c, shared with the process that has the camera open"""

    _fields_ = (
        ("card", ctypes.c_char * 32),
        ("behaviour", ctypes.c_uint32),
        ("metadata", ctypes.c_uint32),
        ("pixelformat", ctypes.c_uint32),
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("rate", ctypes.c_uint32),
        ("period", ctypes.c_uint32),
        ("widest", ctypes.c_uint32),
        ("highest", ctypes.c_uint32),
        ("slowest", ctypes.c_uint32),
        ("open_error", ctypes.c_uint32),
        ("age_us", ctypes.c_uint32),
        ("changes", ctypes.c_uint32),
        ("streams_started", ctypes.c_uint32),
        ("frames", ctypes.c_uint32),
        ("frame_bytes", ctypes.c_uint32),
        ("frame_count", ctypes.c_uint32),
        ("control_count", ctypes.c_uint32),
        ("controls", FakeControl * 8),
    )

    def control(self, name: bytes) -> FakeControl:
        found: FakeControl = next(control for control in self.controls if control.name == name)
        return found


WEBCAM_CONTROLS = (
    FakeControl(GAIN, INTEGER, b"Gain", 0, 100, 1, 10, 10),
    FakeControl(EXPOSURE_AUTO, MENU, b"Auto Exposure", 0, 3, 1, 3, 3),
    FakeControl(EXPOSURE_ABSOLUTE, INTEGER, b"Exposure Time, Absolute", 3, 2047, 1, 250, 250),
    FakeControl(EXPOSURE_AUTO_PRIORITY, BOOLEAN, b"Exposure, Dynamic Framerate", 0, 1, 1, 0, 1),
    FakeControl(AUTO_WHITE_BALANCE, BOOLEAN, b"White Balance, Automatic", 0, 1, 1, 1, 1),
    FakeControl(
        WHITE_BALANCE_TEMPERATURE, INTEGER, b"White Balance Temperature", 2000, 6500, 1, 4000, 4000
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


@contextmanager
def camera_process(folder: Path) -> Iterator[CameraProcess]:
    """A machine without cameras, and a process that runs on it."""
    process = CameraProcess(build_library(folder), Machine(folder))
    try:
        yield process
    finally:
        process.close()


class CameraProcess:
    """A process that sees the machine's cameras; see `camera_process.py` for its side."""

    def __init__(self, library: Path, machine: Machine) -> None:
        self.machine = machine
        environment = os.environ | {
            "LD_PRELOAD": str(library),
            "TAMS_FAKE_V4L2": str(machine.dev),
            "G_DEBUG": "fatal-warnings",
        }
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "tests.hw.v4l2.camera_process",
                str(machine.dev),
                str(machine.sys),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            env=environment,
        )

    def ask(self, *request: Any) -> Any:
        """Have it done there; the errors of TAMS are raised here again."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        pickle.dump(request, self._process.stdin)
        self._process.stdin.flush()
        failure, answer = pickle.load(self._process.stdout)
        if failure:
            raise _ERRORS[failure](answer)
        return answer

    def cameras(self) -> list[CameraInfo]:
        return list(self.ask("list"))

    def close(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        exit_code = self._process.wait(30)
        self._process.stdout.close()
        assert exit_code == 0


class RemoteCamera(Camera):
    """A V4L2 camera that lives in the process which sees it."""

    def __init__(
        self, process: CameraProcess, config: CameraConfig, video: VideoConfig = SMALL
    ) -> None:
        self.view = "gt"
        self._process = process
        self._number = process.ask("make", self.view, config, video)

    def start(self) -> None:
        self._do("start")

    def next_frame(self, timeout_s: float) -> Frame | None:
        frame: Frame | None = self._do("next_frame", timeout_s)
        return frame

    def close(self) -> None:
        self._do("close")

    def notes(self) -> list[tuple[str, str]]:
        return list(self._process.ask("notes_of", self._number))

    def _do(self, name: str, *arguments: Any) -> Any:
        return self._process.ask("do", self._number, name, arguments)
