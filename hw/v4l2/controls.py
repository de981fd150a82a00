"""Exposure, white balance and other V4L2 controls: what to set, from the configuration."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import FileIO

from hw.v4l2.ioctl import G_CTRL, QUERY_EXT_CTRL, S_CTRL, ask, every
from tams_app.config import CameraConfig
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
