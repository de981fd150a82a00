"""A recorded hand: the same motion again, as old as it was, and released at the end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.station.recorded_hand import ReplayedController
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

PERIOD_NS = 8 * NS_PER_MS
START_NS = 5_000 * NS_PER_MS
LATER_NS = 77_777 * NS_PER_MS


def reading(number: int, **changes) -> tuple[int, ControllerSample]:
    """One of a hand that moves 1 mm and turns 0.01 rad each period, read 1 ms after its pose."""
    t_ns = START_NS + number * PERIOD_NS
    turned = Rotation.from_rotvec([0.0, 0.01 * number, 0.0])
    fields = {
        "status": ControllerStatus.OK,
        "pose": Pose(np.array([0.001 * number, 1.0, 0.0]), turned),
        "pose_ns": t_ns - NS_PER_MS,
        "buttons_ns": t_ns,
        "trigger": 1.0,
        "grip": 0.0,
        "a": number >= 3,
        "b": False,
        "menu": False,
    }
    return t_ns, ControllerSample(**{**fields, **changes})


def replay(readings) -> ReplayedController:
    controller = ReplayedController(readings)
    controller.start()
    controller.sample(LATER_NS)
    return controller


def test_at_the_recorded_times_it_says_what_was_recorded():
    readings = [reading(number) for number in range(6)]
    controller = replay(readings)
    for t_ns, recorded in readings:
        now_ns = LATER_NS + t_ns - START_NS
        sample = controller.sample(now_ns)
        np.testing.assert_allclose(sample.pose.position, recorded.pose.position, atol=1e-12)
        assert (sample.pose.rotation * recorded.pose.rotation.inv()).magnitude() < 1e-9
        assert (sample.trigger, sample.a) == (recorded.trigger, recorded.a)
        assert now_ns - sample.pose_ns == NS_PER_MS
        assert sample.buttons_ns == now_ns


@given(st.floats(0.0, 5.0))
def test_in_between_the_hand_glides_and_the_buttons_wait(place):
    controller = replay([reading(number) for number in range(6)])
    sample = controller.sample(LATER_NS + round(place * PERIOD_NS))
    assert sample.pose.position[0] == pytest.approx(0.001 * place, abs=1e-8)
    assert sample.pose.rotation.magnitude() == pytest.approx(0.01 * place, abs=1e-7)
    assert sample.a == (round(place * PERIOD_NS) >= 3 * PERIOD_NS)


def test_a_pose_that_had_stopped_coming_gets_old_again():
    last = reading(1)[1]
    frozen = [reading(n, pose=last.pose, pose_ns=last.pose_ns) for n in range(2, 6)]
    controller = replay([reading(0), reading(1), *frozen])
    now_ns = LATER_NS + 5 * PERIOD_NS
    assert now_ns - controller.sample(now_ns).pose_ns == 4 * PERIOD_NS + NS_PER_MS


def test_a_lost_pose_is_lost_again():
    lost = {"pose": None, "status": ControllerStatus.TRACKING_LOST, "pose_ns": START_NS}
    controller = replay([reading(0), reading(1), reading(2, **lost), reading(3)])
    before = controller.sample(LATER_NS + PERIOD_NS + PERIOD_NS // 2)
    assert before.status is ControllerStatus.OK
    assert before.pose.position[0] == pytest.approx(0.001)
    during = controller.sample(LATER_NS + 2 * PERIOD_NS + PERIOD_NS // 2)
    assert (during.status, during.pose) == (ControllerStatus.TRACKING_LOST, None)
    assert during.pose_ns == LATER_NS


def test_after_the_last_reading_everything_is_released_and_fresh():
    controller = replay([reading(number) for number in range(6)])
    now_ns = LATER_NS + 60 * PERIOD_NS
    sample = controller.sample(now_ns)
    assert (sample.trigger, sample.a, sample.menu) == (0.0, False, False)
    assert (sample.pose_ns, sample.buttons_ns) == (now_ns, now_ns)
    assert sample.status is ControllerStatus.OK


def test_before_its_start_and_after_its_end_it_is_not_there():
    controller = ReplayedController([reading(0), reading(1)])
    assert controller.sample(LATER_NS).status is ControllerStatus.DISCONNECTED
    controller.start()
    assert controller.sample(LATER_NS + 10).status is ControllerStatus.OK
    controller.pulse(Haptic.FAULT)
    controller.close()
    controller.close()
    assert controller.sample(LATER_NS + 20).pose is None


def test_a_hand_without_readings_is_refused():
    with pytest.raises(ValueError, match="without a single reading"):
        ReplayedController([])
