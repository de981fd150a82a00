"""What the robot's side says of its session is taken whole, or refused in a sentence."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgspec
import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.config.motion import WORKSPACE
from tams_app.errors import TamsError
from tams_app.link.messages import SessionDescription, decode, encode
from tams_app.link.proof import WELCOME_BYTES
from tams_app.robot.linked_operator import driving_of
from tams_app.session.robot import for_robot
from tams_app.station.robot_call import driven, follow, repair_of
from tams_app.video.core.repair import RepairRule
from tests.link.test_messages import WELCOME

pytestmark = pytest.mark.untimed

RULE = RepairRule(True, 60, 300.0)


def heard(repair: dict[str, Any]) -> SessionDescription:
    """What arrives of a robot's side with this rule of repair."""
    return decode(encode(msgspec.structs.replace(WELCOME, repair=repair)), SessionDescription)


def test_the_robots_rule_of_repair_is_followed() -> None:
    assert repair_of(heard(asdict(RULE))) == RULE


@pytest.mark.parametrize(
    "repair",
    [{}, {**asdict(RULE), "newer": 1}, {**asdict(RULE), "latency_ms": "low"}],
    ids=["nothing", "a newer setting", "a value of another type"],
)
def test_a_rule_of_repair_of_another_version_is_refused_in_a_sentence(
    repair: dict[str, Any],
) -> None:
    with pytest.raises(TamsError, match="install the same version on both computers"):
        repair_of(heard(repair))


TURNED = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def robots(**changes: Any) -> SessionDescription:
    """What arrives of a robot's side whose configuration has these `changes`."""
    config = load_config(None, {key.replace("__", "."): value for key, value in changes.items()})
    told = msgspec.structs.replace(
        WELCOME,
        video=config.video.model_dump(mode="json"),
        hand_rotation=config.hand.rotation,
        workspace=config.limits.model_dump(mode="json", include=WORKSPACE),
        driving=driving_of(config),
    )
    return decode(encode(told), SessionDescription)


def test_the_arm_moves_as_the_robots_side_has_it() -> None:
    ours = load_config(None, {"limits.max_speed_mm_s": 100.0, "hand.translation_scale": 0.5})
    theirs = load_config(None, {"limits.max_speed_mm_s": 150.0, "limits.radius_max_mm": 400.0})
    there = driven(
        robots(limits__max_speed_mm_s=150.0, limits__radius_max_mm=400.0, hand__rotation=TURNED),
        ours,
    )
    assert there is not None
    assert there.limits == theirs.limits
    assert there.hand.rotation == TURNED
    assert there.hand.translation_scale == theirs.hand.translation_scale
    assert there.rig.enabled is WELCOME.simulated


def test_the_operator_is_shown_the_robots_workspace_and_keeps_their_own_limits() -> None:
    ours = load_config(None, {"limits.max_speed_mm_s": 100.0})
    config = follow(robots(limits__radius_max_mm=400.0, hand__rotation=TURNED), ours)
    assert config.limits.radius_max_mm == 400.0
    assert config.limits.max_speed_mm_s == 100.0
    assert config.hand.rotation == TURNED


def test_where_the_robots_side_has_too_much_to_tell_nothing_is_predicted() -> None:
    assert driven(msgspec.structs.replace(robots(), driving=None), load_config(None, {})) is None


@pytest.mark.parametrize("name", ["tams.yaml", "lite6.yaml"])
def test_what_the_shipped_configurations_have_to_tell_fits_into_an_answer(name: str) -> None:
    config = for_robot(load_config(CONFIG_DIRECTORY / name, {}))
    told = msgspec.structs.replace(
        WELCOME,
        session="0" * 16,
        name="x" * 60,
        video=config.video.model_dump(mode="json"),
        repair=asdict(RULE),
        hand_rotation=((0.123456789,) * 3,) * 3,
        workspace=config.limits.model_dump(mode="json", include=WORKSPACE),
        driving=driving_of(config),
    )
    assert len(encode(told)) <= WELCOME_BYTES


def test_no_address_of_the_robots_network_is_told() -> None:
    told = driving_of(load_config(None, {"arm.host": "192.168.7.33"}))
    assert "192.168.7.33" not in str(told)


def test_driving_of_another_version_is_refused_in_a_sentence() -> None:
    strange = msgspec.structs.replace(robots(), driving={"limits": {"newer": 1}})
    with pytest.raises(TamsError, match="install the same version on both computers"):
        driven(strange, load_config(None, {}))
