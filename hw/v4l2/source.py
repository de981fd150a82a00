"""Real cameras: V4L2 devices, chosen by name, serial or path, with their controls fixed."""

from __future__ import annotations

from collections.abc import Callable
from io import FileIO

from hw.gstreamer.capture import GstCapture
from hw.v4l2.controls import (
    Setting,
    apply_settings,
    controls_of,
    not_kept,
    plan_settings,
    refuse_long_exposure,
)
from hw.v4l2.devices import CameraInfo, choose_camera, choose_mode, list_cameras
from tams_app import gst
from tams_app.config import CameraConfig, VideoConfig
from tams_app.errors import DeviceError


class V4l2Source:
    """One V4L2 camera, searched for at each opening since plugging changes the device numbers."""

    noisy = True
    endless = True

    def __init__(
        self,
        view: str,
        config: CameraConfig,
        video: VideoConfig,
        find: Callable[[], list[CameraInfo]] = list_cameras,
    ) -> None:
        """ConfigError if the exposure is longer than a frame."""
        refuse_long_exposure(view, config, video.fps)
        self._config = config
        self._video = video
        self._find = find
        self._info: CameraInfo | None = None
        self._settings: list[Setting] = []

    @property
    def label(self) -> str:
        config = self._config
        keys = (config.name, config.serial and f"serial {config.serial}", config.path)
        where = self._info.node if self._info else ""
        return ", ".join(dict.fromkeys(key for key in (*keys, where) if key))

    def open(self) -> GstCapture:
        """Find it, set its controls, start it; DeviceError in one sentence if that fails."""
        config, video = self._config, self._video
        mjpeg = config.pixel_format == "mjpeg"
        gst.require_elements(("v4l2src", "jpegdec") if mjpeg else ("v4l2src",))
        info = choose_camera(self._find(), config.name, config.serial, config.path)
        self._info = info
        rate = choose_mode(info, mjpeg, video.width, video.height, video.fps)
        self._set_controls(info)
        kind, decoder = ("image/jpeg", " ! jpegdec") if mjpeg else ("video/x-raw", "")
        return GstCapture(
            f"v4l2src name=camera ! {kind},width={video.width},height={video.height},"
            f"framerate={rate.numerator}/{rate.denominator}{decoder}",
            video,
            properties={"camera": {"device": info.node}},
        )

    def complaints(self) -> list[str]:
        """Controls that did not stay as they were set."""
        if self._info is None:
            return []
        try:
            with FileIO(self._info.node, "r+") as device:
                return not_kept(device, self._settings)
        except OSError as error:
            return [f"does not tell its controls: {error.strerror}"]

    def _set_controls(self, info: CameraInfo) -> None:
        try:
            with FileIO(info.node, "r+") as device:
                self._settings = plan_settings(self._config, controls_of(device))
                apply_settings(device, self._settings)
        except OSError as error:
            raise DeviceError(f"{info} cannot be opened: {error.strerror}") from error
