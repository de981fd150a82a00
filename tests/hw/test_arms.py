"""The kinds of arm, and what they allow the configuration to ask of them."""

from __future__ import annotations

from typing import Any

import pytest

from hw.arms import arm_kind, check_limits
from tams_app.config import load_config
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed


def check(**overrides: Any) -> None:
    config = load_config(overrides=overrides)
    check_limits(config.arm, config.limits)


def test_the_default_configuration_is_within_its_arms_limits() -> None:
    check()


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (
            {"arm.ready_joints_deg": [0, 0, -4, 0, 0, 0]},
            "arm.ready_joints_deg: joint 3 turns from -3.5 to 300 degrees, not to -4",
        ),
        ({"arm.ready_joints_deg": [0, 0, 0, 0, 125, 0]}, "joint 5 turns from -124 to 124 .* 125"),
        (
            {
                "limits.max_speed_mm_s": 501,
                "limits.stop.acceleration_m_s2": 20,
                "limits.stop.jerk_m_s3": 2000,
            },
            "limits.max_speed_mm_s is 501: the Lite 6 allows at most 500",
        ),
        ({"limits.radius_max_mm": 441}, "limits.radius_max_mm is 441: .* at most 440"),
        (
            {"limits.stop.acceleration_m_s2": 51, "limits.stop.jerk_m_s3": 5000},
            "limits.stop.acceleration_m_s2 is 51: .* at most 50",
        ),
        (
            {
                "limits.max_rotation_rad_s": 3.2,
                "limits.stop.acceleration_rad_s2": 200,
                "limits.stop.jerk_rad_s3": 20000,
            },
            "limits.max_rotation_rad_s is 3.2: .* at most 3.14159",
        ),
    ],
)
def test_more_than_the_arm_can_do_is_refused_with_its_bound(
    overrides: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        check(**overrides)


def test_an_unknown_model_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(ConfigError, match="'lite7' is not one of lite6"):
        arm_kind("lite7")
