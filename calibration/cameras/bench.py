"""What the steps of the wizard need of the cameras, and all cameras that are plugged in here."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

import numpy as np

from calibration.cameras.flashes import Flashes, flashing_window
from calibration.kit import WizardUI
from hw.arm_report import ReportWatch
from hw.arms import arm_kind
from hw.gstreamer.camera import GstCamera
from hw.v4l2.devices import CameraInfo, choose_camera, choose_mode, list_cameras
from hw.v4l2.source import V4l2Source
from tams_app.config import ArmConfig, CameraConfig, VideoConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame, Vector
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

_CHUNK_S = 0.5
_POLL_NS = 2 * NS_PER_MS
_SILENT_NS = 500 * NS_PER_MS
_BY_PATH = "/v4l/by-path/"


class Task(Enum):
    """What the person is asked to do; a simulated one does it."""

    REST = auto()  # keep out of sight, hold still
    WAVE = auto()  # a hand before one camera
    SHOW_SCREEN = auto()  # point it at the screen that flashes
    SHOW_BOARD = auto()  # hold the board before one camera, from many sides
    MOVE_ARM = auto()  # the board lies still, the arm goes to many poses
    MOVE_BOARD = auto()  # the board goes to another place


class Bench(Protocol):
    """All cameras of the machine, open; close it in the end.

    `attended`: a person does what is prompted, and is asked; else `done` shows when a simulated
    one has finished.
    """

    source: str  # where it all comes from, for the calibration's provenance
    attended: bool
    fps: int
    width: int  # of the pictures
    height: int
    cameras: Sequence[str]  # the candidates, as people call them
    refused: Sequence[str]  # those that cannot be used, a sentence each

    def binding(self, camera: str) -> dict[str, str]:
        """The configuration's keys that choose this camera."""

    def camera_of(self, config: CameraConfig) -> str:
        """The candidate that a configuration chooses, "" if none."""

    def prompt(self, task: Task, view: str) -> None:
        """The person has been asked; `view` is the one meant, "" for all."""

    @property
    def done(self) -> bool:
        """Whether a simulated person has finished what was asked last."""

    def shots(self, cameras: Sequence[str], seconds: float, every: int = 1) -> Iterator[Frame]:
        """The frames of some cameras as they come for so long; each `every`-th only.

        The view of a frame is here the camera, as people call it.
        """

    def screen(self) -> AbstractContextManager[Flashes]:
        """Let a screen flash; SetupError where there is no display."""

    def listening(self) -> AbstractContextManager[None]:
        """Listen to the arm, which nothing here moves; DeviceError if it does not report."""

    def joints(self) -> Vector | None:
        """The arm's newest joints [rad], shape (6,); None: it has not reported lately."""

    def close(self) -> None:
        """Let go of all cameras; may be called twice."""


def until_done(
    ui: WizardUI, bench: Bench, cameras: Sequence[str], most_s: float, every: int = 1
) -> Iterator[Frame]:
    """Frames until Enter is pressed, a simulated person has finished, or `most_s` are over."""
    for _ in range(round(most_s / _CHUNK_S)):
        yield from bench.shots(cameras, _CHUNK_S, every)
        if ui.pressed() or bench.done:
            return


def agreed(ui: WizardUI, bench: Bench, question: str) -> bool:
    """The person's answer; no where only a simulated person or no terminal is there."""
    return bench.attended and ui.attended and ui.yes(question)


@dataclass(slots=True)
class _Plugged:
    info: CameraInfo
    config: CameraConfig
    camera: GstCamera


class LiveBench:
    """Every V4L2 camera that offers the video's size and rate, opened with its automatics on."""

    source = "the cameras of this machine, moved and shown things by a person"
    attended = True
    done = False  # only the person knows

    def __init__(
        self,
        video: VideoConfig,
        arm: ArmConfig,
        clock: Clock,
        find: Callable[[], list[CameraInfo]] = list_cameras,
    ) -> None:
        self.fps, self.width, self.height = video.fps, video.width, video.height
        self._video, self._arm, self._clock, self._find = video, arm, clock, find
        self._plugged: dict[str, _Plugged] = {}
        self.refused: Sequence[str] = ()
        self._watch: ReportWatch | None = None
        self._joints: Vector | None = None
        self._reported_ns = 0
        try:
            found = find()
        except OSError as error:
            raise DeviceError(
                f"the cameras cannot be listed ({error.strerror}); try again"
            ) from error
        for info in found:
            self._open(info, found)
        self.cameras: Sequence[str] = tuple(self._plugged)

    def binding(self, camera: str) -> dict[str, str]:
        keys = {"source", "name", "serial", "path", "file", "pixel_format"}
        return self._plugged[camera].config.model_dump(include=keys)

    def camera_of(self, config: CameraConfig) -> str:
        try:
            found = [plugged.info for plugged in self._plugged.values()]
            info = choose_camera(found, config.name, config.serial, config.path)
        except DeviceError:  # the wizard names the one that is missing
            return ""
        return next(name for name, plugged in self._plugged.items() if plugged.info is info)

    def prompt(self, task: Task, view: str) -> None:
        """A person has read it."""

    def shots(self, cameras: Sequence[str], seconds: float, every: int = 1) -> Iterator[Frame]:
        end_ns = self._clock.now_ns() + round(seconds * NS_PER_S)
        while self._clock.now_ns() < end_ns:
            idle = True
            for name in cameras:
                frame = self._plugged[name].camera.next_frame(0.0)
                if frame is not None:
                    idle = False
                    if frame.index % every == 0:
                        yield frame
            if idle:
                self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)

    def screen(self) -> AbstractContextManager[Flashes]:
        return flashing_window(self._clock)

    @contextmanager
    def listening(self) -> Iterator[None]:
        watch_type = pkgutil.resolve_name(arm_kind(self._arm.model).report_watch)
        watch: ReportWatch = watch_type(self._arm.host, self._arm.report_port)
        watch.start()
        self._watch, self._joints, self._reported_ns = watch, None, self._clock.now_ns()
        try:
            yield
        finally:
            self._watch = None
            watch.close()

    def joints(self) -> Vector | None:
        now_ns = self._clock.now_ns()
        report = None if self._watch is None else self._watch.newest(now_ns)
        if report is not None:
            self._joints, self._reported_ns = np.array(report.joints), now_ns
        elif now_ns - self._reported_ns > _SILENT_NS:
            self._joints = None
        return self._joints

    def close(self) -> None:
        for plugged in self._plugged.values():
            plugged.camera.close()

    def _open(self, info: CameraInfo, found: Sequence[CameraInfo]) -> None:
        name = f"{info.name} ({info.serial or info.node.rsplit('/', 1)[-1]})"
        try:
            config = bind(info, found, self._video)
            source = V4l2Source(name, config, self._video, self._find)
            camera = GstCamera(name, source, self._video, self._clock, lambda _level, _text: None)
            camera.start()
        except DeviceError as error:
            self.refused = (*self.refused, str(error))
        else:
            self._plugged[name] = _Plugged(info, config, camera)


def bind(info: CameraInfo, found: Sequence[CameraInfo], video: VideoConfig) -> CameraConfig:
    """How to find this camera again: by serial, else by its USB port, else by name, else by node.

    Only what no other camera has will do. DeviceError if it does not offer the video's mode.
    """
    mjpeg = True
    try:
        choose_mode(info, mjpeg, video.width, video.height, video.fps)
    except DeviceError:
        mjpeg = False
        choose_mode(info, mjpeg, video.width, video.height, video.fps)
    others = [other for other in found if other.node != info.node]
    keys: dict[str, str]
    ports = [link for link in info.links if _BY_PATH in link]
    if info.serial and all(other.serial != info.serial for other in others):
        keys = {"serial": info.serial}
    elif ports:
        keys = {"path": ports[0]}
    elif info.name and all(other.name != info.name for other in others):
        keys = {"name": info.name}
    else:
        keys = {"path": info.node}
    return CameraConfig.model_validate({**keys, "pixel_format": "mjpeg" if mjpeg else "raw"})
