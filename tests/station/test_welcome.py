"""What the robot's side says of its session is taken whole, or refused in a sentence."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgspec
import pytest

from tams_app.errors import TamsError
from tams_app.link.messages import Welcome, decode, encode
from tams_app.station.welcome import repair_of
from tams_app.video.core.repair import RepairRule
from tests.link.test_messages import WELCOME

pytestmark = pytest.mark.untimed

RULE = RepairRule(True, 60, 300.0)


def heard(repair: dict[str, Any]) -> Welcome:
    """What arrives of a robot's side with this rule of repair."""
    return decode(encode(msgspec.structs.replace(WELCOME, repair=repair)), Welcome)


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
