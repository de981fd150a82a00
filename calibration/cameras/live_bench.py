"""The cameras that are plugged into this machine, all of them."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np

from calibration.cameras.bench import Arm, Task
from calibration.cameras.flashes import Flashes, flashing_window
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

_POLL_NS = 2 * NS_PER_MS
_SILENT_NS = 500 * NS_PER_MS
_BY_PATH = "/v4l/by-path/"


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
        self._refused: list[str] = []
        try:
            found = find()
        except OSError as error:
            raise DeviceError(
                f"the cameras cannot be listed ({error.strerror}); try again"
            ) from error
        for info in found:
            self._open(info, found)

    @property
    def cameras(self) -> Sequence[str]:
        return tuple(self._plugged)

    @property
    def refused(self) -> Sequence[str]:
        return tuple(self._refused)

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
    def arm(self) -> Iterator[Arm]:
        watch_type = pkgutil.resolve_name(arm_kind(self._arm.model).report_watch)
        watch: ReportWatch = watch_type(self._arm.host, self._arm.report_port)
        watch.start()
        joints: Vector | None = None
        heard_ns = self._clock.now_ns()

        def newest() -> Vector | None:
            nonlocal joints, heard_ns
            now_ns = self._clock.now_ns()
            report = watch.newest(now_ns)
            if report is not None:
                joints, heard_ns = np.array(report.joints), now_ns
            elif now_ns - heard_ns > _SILENT_NS:
                joints = None
            return joints

        try:
            yield newest
        finally:
            watch.close()

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
            self._refused.append(str(error))
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
