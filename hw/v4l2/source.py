"""Real cameras: V4L2 devices, chosen by name, serial or path, with their controls fixed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from io import FileIO

from hw.gstreamer.capture import GstCapture
from hw.v4l2.devices import (
    G_CTRL,
    QUERY_EXT_CTRL,
    S_CTRL,
    CameraInfo,
    ask,
    choose_camera,
    choose_mode,
    every,
    list_cameras,
)
from tams_app import gst
from tams_app.config import CameraConfig, VideoConfig
from tams_app.errors import ConfigError, DeviceError

# linux/v4l2-controls.h: these keep their numbers, while their names differ between kernels
AUTO_WHITE_BALANCE = 0x0098_090C
WHITE_BALANCE_TEMPERATURE = 0x0098_091A
EXPOSURE_AUTO = 0x009A_0901
EXPOSURE_ABSOLUTE = 0x009A_0902  # in units of 100 µs
EXPOSURE_AUTO_PRIORITY = 0x009A_0903  # may lengthen the frame period in the dark

MANUAL_EXPOSURE = 1  # of EXPOSURE_AUTO
EXPOSURE_UNIT_US = 100

_UNUSABLE = 0x0001 | 0x0004 | 0x0100  # disabled, read-only, no number
_HEADING = 6  # type
_NEXT = 0x8000_0000


@dataclass(frozen=True, slots=True)
class Control:
    """A control of a camera, named as v4l2-ctl prints it."""

    id: int
    name: str
    minimum: int
    maximum: int
    default: int


@dataclass(frozen=True, slots=True)
class Setting:
    """A control and the value it is to have."""

    control: Control
    value: int


def controls_of(device: FileIO) -> list[Control]:
    """Everything that can be set to a number, headings left out; OSError if it is pulled out."""
    found = every(device, QUERY_EXT_CTRL, next_flag=_NEXT)
    return [
        Control(
            number, control_name(title.rstrip(b"\0").decode(errors="replace")), low, high, usual
        )
        for number, kind, title, low, high, _step, usual, flags, *_ in found
        if kind != _HEADING and not flags & _UNUSABLE
    ]


def control_name(title: str) -> str:
    """`Exposure Time, Absolute` → `exposure_time_absolute`."""
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")


def refuse_long_exposure(view: str, config: CameraConfig, fps: int) -> None:
    """ConfigError if the exposure does not fit into a frame: the frame rate would drop."""
    longest_us = 1_000_000 / fps
    if config.exposure_us is not None and config.exposure_us > longest_us:
        raise ConfigError(
            f"cameras.{view}.exposure_us: {config.exposure_us:g} is longer than a frame at "
            f"{fps}/s; set {longest_us:.0f} or less"
        )


def plan_settings(config: CameraConfig, has: Sequence[Control]) -> list[Setting]:
    """The settings in the order in which to make them: the automatics before the values.

    Without exposure or white balance in the configuration they are automatic, whatever an earlier
    program left. The automatic exposure must not lower the frame rate. `controls` come last.
    DeviceError names a control that the camera does not have, or a value it cannot take.
    """
    wanted: list[tuple[int, str, int]] = []
    optional: list[tuple[int, int | None]] = [(EXPOSURE_AUTO_PRIORITY, 0)]
    if config.exposure_us is not None:
        units = max(1, round(config.exposure_us / EXPOSURE_UNIT_US))
        wanted.append((EXPOSURE_AUTO, "exposure mode", MANUAL_EXPOSURE))
        wanted.append((EXPOSURE_ABSOLUTE, "exposure time", units))
    else:
        optional.append((EXPOSURE_AUTO, None))
    if config.white_balance_k is not None:
        optional.append((AUTO_WHITE_BALANCE, 0))
        wanted.append(
            (WHITE_BALANCE_TEMPERATURE, "white balance temperature", config.white_balance_k)
        )
    else:
        optional.append((AUTO_WHITE_BALANCE, 1))
    by_id = {control.id: control for control in has}
    plan = [
        Setting(control, control.default if value is None else value)
        for number, value in optional
        if (control := by_id.get(number)) and control.name not in config.controls
    ]
    plan += [_setting(by_id.get(number), what, value, has) for number, what, value in wanted]
    by_name = {control.name: control for control in has}
    named = config.controls.items()
    return plan + [_setting(by_name.get(name), name, value, has) for name, value in named]


def apply_settings(device: FileIO, settings: Iterable[Setting]) -> None:
    """Set them one by one; DeviceError names the one that the camera refuses."""
    for setting in settings:
        try:
            ask(device, S_CTRL, setting.control.id, setting.value)
        except OSError as error:
            raise DeviceError(
                f"the camera refuses to set {setting.control.name} to {setting.value}: "
                f"{error.strerror}; correct or remove it"
            ) from error


def not_kept(device: FileIO, settings: Iterable[Setting]) -> list[str]:
    """The settings that the camera has changed by itself, as the ends of sentences."""
    values = {setting.control: setting.value for setting in settings}
    found = {control: ask(device, G_CTRL, control.id)[1] for control in values}
    return [
        f"keeps {control.name} at {found[control]} although {value} was set"
        for control, value in values.items()
        if found[control] != value
    ]


def _setting(control: Control | None, what: str, value: int, has: Sequence[Control]) -> Setting:
    if control is None:
        names = ", ".join(sorted(control.name for control in has)) or "none"
        raise DeviceError(f"the camera has no control {what}; remove it; its controls: {names}")
    if not control.minimum <= value <= control.maximum:
        raise DeviceError(
            f"the camera cannot set {control.name} to {value}; "
            f"set {control.minimum} to {control.maximum}"
        )
    return Setting(control, value)


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
