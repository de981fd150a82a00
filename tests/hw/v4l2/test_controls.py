"""Which controls are set, in which order, and what is refused: pure, on recorded controls."""

from __future__ import annotations

from typing import Any

import pytest

from hw.v4l2.source import (
    AUTO_WHITE_BALANCE,
    EXPOSURE_ABSOLUTE,
    EXPOSURE_AUTO,
    EXPOSURE_AUTO_PRIORITY,
    WHITE_BALANCE_TEMPERATURE,
    Control,
    control_name,
    plan_settings,
)
from tams_app.config import CameraConfig
from tams_app.errors import DeviceError

pytestmark = pytest.mark.untimed

GAIN = Control(0x0098_0913, "gain", 0, 255, 64)
WEBCAM = (
    Control(AUTO_WHITE_BALANCE, "white_balance_automatic", 0, 1, 1),
    GAIN,
    Control(WHITE_BALANCE_TEMPERATURE, "white_balance_temperature", 2000, 7500, 4000),
    Control(EXPOSURE_AUTO, "auto_exposure", 0, 3, 3),
    Control(EXPOSURE_ABSOLUTE, "exposure_time_absolute", 3, 2047, 250),
    Control(EXPOSURE_AUTO_PRIORITY, "exposure_dynamic_framerate", 0, 1, 0),
)


def config(**keys: Any) -> CameraConfig:
    return CameraConfig(name="Webcam", **keys)


def plan(has: tuple[Control, ...] = WEBCAM, **keys: Any) -> list[tuple[str, int]]:
    return [(setting.control.name, setting.value) for setting in plan_settings(config(**keys), has)]


def test_a_value_is_set_after_its_automatic_is_off_and_an_exposure_in_units_of_100_us() -> None:
    planned = plan(exposure_us=8000, white_balance_k=4600)
    assert planned.index(("auto_exposure", 1)) < planned.index(("exposure_time_absolute", 80))
    manual = planned.index(("white_balance_automatic", 0))
    assert manual < planned.index(("white_balance_temperature", 4600))


def test_without_them_exposure_and_white_balance_are_automatic_again() -> None:
    planned = dict(plan())
    assert planned["auto_exposure"] == 3
    assert planned["white_balance_automatic"] == 1
    assert "exposure_time_absolute" not in planned
    assert "white_balance_temperature" not in planned
    assert plan(has=()) == []


@pytest.mark.parametrize("keys", [{}, {"exposure_us": 8000}])
def test_the_exposure_may_never_lengthen_the_frame(keys: dict[str, Any]) -> None:
    assert dict(plan(**keys))["exposure_dynamic_framerate"] == 0


def test_controls_by_name_come_last_and_have_the_last_word() -> None:
    assert plan(controls={"gain": 17})[-1] == ("gain", 17)
    named = plan(controls={"auto_exposure": 1, "exposure_dynamic_framerate": 1})
    assert [value for name, value in named if name == "auto_exposure"] == [1]
    assert [value for name, value in named if name == "exposure_dynamic_framerate"] == [1]


@pytest.mark.parametrize(
    ("keys", "name"),
    [
        ({"exposure_us": 8000}, "exposure mode"),
        ({"white_balance_k": 4600}, "white balance temperature"),
        ({"controls": {"zoom_absolute": 3}}, "zoom_absolute"),
    ],
)
def test_a_control_the_camera_lacks_is_named_beside_those_it_has(
    keys: dict[str, Any], name: str
) -> None:
    with pytest.raises(DeviceError, match=f"no control {name}; remove it; its controls: gain"):
        plan(has=(GAIN,), **keys)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"exposure_us": 100}, "cannot set exposure_time_absolute to 1; set 3 to 2047"),
        ({"white_balance_k": 9000}, "cannot set white_balance_temperature to 9000"),
        ({"controls": {"gain": 256}}, "cannot set gain to 256; set 0 to 255"),
        ({"controls": {"gain": -1}}, "cannot set gain to -1"),
    ],
)
def test_a_value_out_of_range_is_refused_with_the_range(
    keys: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(DeviceError, match=sentence):
        plan(**keys)


@pytest.mark.parametrize(
    ("title", "name"),
    [
        ("Exposure Time, Absolute", "exposure_time_absolute"),
        ("White Balance, Automatic", "white_balance_automatic"),
        ("Exposure (Absolute)", "exposure_absolute"),
        ("Gain", "gain"),
    ],
)
def test_controls_are_named_as_v4l2_ctl_prints_them(title: str, name: str) -> None:
    assert control_name(title) == name
