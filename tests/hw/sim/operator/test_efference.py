import numpy as np
import pytest

from hw.sim.operator.efference import FOLLOW_LAG_NS, EfferenceCopy, FollowCheck
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

STEP_NS = 10 * NS_PER_MS
ZERO = np.zeros(3)


def test_motion_shows_only_in_views_taken_after_it_and_the_lag():
    asked = EfferenceCopy()
    for step in range(1, 11):
        asked.add(step * STEP_NS, np.array([0.001, 0, 0]), ZERO)
    assert asked.total[0] == pytest.approx(0.010)
    assert asked.shown_at(FOLLOW_LAG_NS)[0] == 0.0
    assert asked.shown_at(FOLLOW_LAG_NS + 4 * STEP_NS)[0] == pytest.approx(0.004)
    asked.idle(20 * STEP_NS)
    assert asked.shown_at(FOLLOW_LAG_NS + 30 * STEP_NS)[0] == pytest.approx(0.010)


def _verdicts(part: float, speed: float = 0.1, turning: bool = False) -> list[bool]:
    """What the check says in 3 s of steady motion of which `part` shows."""
    check, verdicts = FollowCheck(), []
    for step in range(300):
        size = speed * step * 0.01
        shown = np.zeros(6)
        shown[5 if turning else 0] = size
        tool = Pose(
            ZERO if turning else np.array([part * size, 0, 0]),
            Rotation.from_rotvec([0, 0, part * size if turning else 0.0]),
        )
        verdict = check.step(step * STEP_NS, shown, tool)
        if verdict is not None:
            verdicts.append(verdict)
    return verdicts


@pytest.mark.parametrize("turning", [False, True])
def test_a_tool_that_follows_is_trusted_and_one_that_does_not_is_noticed(turning):
    speed = 0.4 if turning else 0.1
    assert all(_verdicts(0.8, speed, turning))
    assert len(_verdicts(0.8, speed, turning)) >= 2
    assert not any(_verdicts(0.05, speed, turning))
    assert len(_verdicts(0.05, speed, turning)) >= 2


def test_a_hand_at_rest_is_no_evidence():
    assert _verdicts(0.0, speed=0.0) == []


def test_what_was_asked_can_be_looked_up_for_any_time_of_the_last_seconds():
    asked = EfferenceCopy()
    for step in range(1, 1001):
        asked.add(step * STEP_NS, np.array([0.001, 0, 0]), ZERO)
    totals = asked.asked_at_each([900 * STEP_NS, 999 * STEP_NS + 1, 2000 * STEP_NS])
    assert [total[0] for total in totals] == pytest.approx([0.9, 0.999, 1.0])
    assert asked.asked_at(900 * STEP_NS)[0] == pytest.approx(0.9)
    assert asked.asked_at(0)[0] == pytest.approx(0.7, abs=0.002)
