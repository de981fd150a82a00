"""One rig per kind of camera: simulated, pattern, file and V4L2."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from hw.camera import Camera
from hw.make_camera import make_camera
from hw.sim.layout import HEIGHT_PX, WIDTH_PX
from hw.sim.world.rig_memory import FrameWriter, SimCamera, remove_memory
from tams_app import gst
from tams_app.config import CameraConfig, VideoConfig
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_S
from tests.hw.v4l2.camera_process import CameraProcess
from tests.hw.v4l2.fake_cameras import SILENT, SMALL

VIEW = "gt"  # the name that their frames must carry
WITHIN_S = 5.0  # for a frame; generous: the machine may be busy


class CameraRig(ABC):
    """Makes cameras of `video`'s frames, and absent and silent ones."""

    video = SMALL
    clock = MonotonicClock()  # of their capture times

    def __init__(self) -> None:
        self.cleaning = ExitStack()

    @abstractmethod
    def camera(self) -> Camera:
        """A camera whose device is there, not started; the one before has been closed."""

    def frames(self, camera: Camera, count: int) -> list[Frame]:
        """The next `count` frames, each of which must come within 5 s."""
        found = []
        for _ in range(count):
            frame = camera.next_frame(WITHIN_S)
            assert frame is not None, f"no frame came within {WITHIN_S:g} s"
            found.append(frame)
        return found

    def absent_camera(self) -> Camera:
        """A camera that is not there, of the kinds that can be absent."""
        raise AssertionError(f"a {type(self).__name__} is never absent")

    def silence(self) -> None:
        """Have the started camera give no more frames, of the kinds that can fall silent."""
        raise AssertionError(f"a {type(self).__name__} never falls silent")


class SimRig(CameraRig):
    """Frames of one grey, published at their instants as a renderer does."""

    video = VideoConfig()

    def __init__(self) -> None:
        super().__init__()
        self._name = new_block_name()
        self.cleaning.callback(remove_memory, self._name)
        self._writer = FrameWriter(self._name)
        self.cleaning.callback(self._writer.close)
        self._renderer = Worker("renderer", self._render)
        self.cleaning.callback(self._renderer.stop)
        self._renderer.start()

    def camera(self) -> Camera:
        return SimCamera(VIEW, self._name, MonotonicClock())

    def absent_camera(self) -> Camera:
        return SimCamera("left", self._name, MonotonicClock())

    def silence(self) -> None:
        self._renderer.stop()

    def _render(self, stop: threading.Event) -> None:
        first_ns = time.monotonic_ns()
        while not stop.is_set():
            number = (time.monotonic_ns() - first_ns) * SMALL.fps // NS_PER_S + 1
            due_ns = first_ns + number * NS_PER_S // SMALL.fps
            MonotonicClock().sleep_until_ns(due_ns)
            image = np.full((HEIGHT_PX, WIDTH_PX, 3), number % 256, np.uint8)
            self._writer.publish(VIEW, number, due_ns, image)


def _make(config: CameraConfig) -> Camera:
    return make_camera(VIEW, config, SMALL, MonotonicClock(), lambda *_: None)


class PatternRig(CameraRig):
    def camera(self) -> Camera:
        return _make(CameraConfig(source="pattern"))


class FileRig(CameraRig):
    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def camera(self) -> Camera:
        video = self._folder / "video.mkv"
        write_video(video, frames=15)
        return _make(CameraConfig(source="file", file=str(video)))

    def absent_camera(self) -> Camera:
        return _make(CameraConfig(source="file", file=str(self._folder / "none.mkv")))


class V4l2Rig(CameraRig):
    """The real v4l2src, in a process where a kernel's device is played."""

    def __init__(self, process: CameraProcess) -> None:
        super().__init__()
        self._process = process
        self._machine = process.machine
        self._webcam = self._machine.plug(name="Webcam")
        self.cleaning.callback(self._machine.unplug)

    def camera(self) -> Camera:
        made: Camera = self._process.camera(CameraConfig(name="Webcam"), VIEW)
        return made

    def absent_camera(self) -> Camera:
        absent: Camera = self._process.camera(CameraConfig(name="Microscope"), VIEW)
        return absent

    def silence(self) -> None:
        self._webcam.behaviour = SILENT


def write_video(
    path: Path,
    frames: int = 30,
    size: str = "width=160,height=120",
    chain: str = "",
    sound: str = "",
) -> None:
    """A video in which every frame is another; without a `chain` of its own in .mkv with sound."""
    Gst: Any = gst.load().Gst
    if not chain:
        chain, buffers = "jpegenc ! matroskamux name=mux", max(1, frames * 44100 // 30 // 1024)
        sound = f"audiotestsrc num-buffers={buffers} ! vorbisenc ! mux."
    pipeline = gst.parse_pipeline(
        f"videotestsrc num-buffers={frames} pattern=smpte horizontal-speed=3 "
        f"! video/x-raw,format=I420,{size},framerate=30/1 ! {chain} ! filesink name=file {sound}"
    )
    pipeline.get_by_name("file").set_property("location", str(path))
    pipeline.set_state(Gst.State.PLAYING)
    kinds = Gst.MessageType.EOS | Gst.MessageType.ERROR
    message = pipeline.get_bus().timed_pop_filtered(60 * Gst.SECOND, kinds)
    gst.shut_down(pipeline)
    assert message.type == Gst.MessageType.EOS, message.parse_error()
