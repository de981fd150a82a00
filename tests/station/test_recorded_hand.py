"""A recorded hand: from a log the same motion again, as old as it was, and released at the end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.errors import ConfigError, LogError
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.parts import Parts
from tams_app.station.hand import OperatorHand
from tams_app.station.recorded_hand import ReplayedController, recorded_hand
from tams_app.units import NS_PER_MS
from tests.session.exchange import Unkept
from tests.synthetic_session import PERIOD_NS, START_NS, tick, write_log

pytestmark = pytest.mark.untimed


def write(path, count):
    return write_log(path, map(tick, range(count)))


def test_a_log_without_a_hand_and_a_file_that_is_none_are_one_sentence(tmp_path):
    with pytest.raises(ConfigError, match=r"rig\.hand_trajectory: .* holds no tick"):
        recorded_hand(write(tmp_path / "session.mcap", 0))
    (tmp_path / "other.mcap").write_bytes(b"none of ours")
    with pytest.raises(LogError, match=r"other\.mcap"):
        recorded_hand(tmp_path / "other.mcap")


def test_the_hand_of_a_log_is_the_configured_one_and_moves_as_it_was_recorded(tmp_path):
    path = write(tmp_path / "session.mcap", 40)
    config = load_config(None, {"rig.hand_trajectory": str(path)})
    log = Unkept(VirtualClock())
    parts = Parts(tmp_path, pytest.fail, 0)
    controller = OperatorHand(config, VirtualClock(), parts, log, is_rig=True).take_controller()
    for number in range(40):
        sample = controller.sample(10 * START_NS + number * PERIOD_NS)
        expected = tick(number).controller
        np.testing.assert_allclose(sample.pose.position, expected.pose.position, atol=1e-9)
        assert sample.trigger == expected.trigger


@pytest.mark.parametrize(("is_rig", "what"), [(True, "rig"), (False, "arm")])
def test_a_person_is_told_whether_they_drive_the_rig_or_an_arm(tmp_path, is_rig, what):
    config = load_config(None, {"controller.device": "keyboard"})
    told = []
    log = Unkept(VirtualClock(), told.append)
    parts = Parts(tmp_path, pytest.fail, 0)
    OperatorHand(config, VirtualClock(), parts, log, is_rig)
    assert told == [f"a person drives the {what}: keyboard"]


# --- between readings -----------------------------------------------------------------------------


STEP_NS = 8 * NS_PER_MS
BEGUN_NS = 5_000 * NS_PER_MS
LATER_NS = 77_777 * NS_PER_MS


def reading(number: int, **changes) -> tuple[int, ControllerSample]:
    """One of a hand that moves 1 mm and turns 0.01 rad each period, read 1 ms after its pose."""
    t_ns = BEGUN_NS + number * STEP_NS
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
        now_ns = LATER_NS + t_ns - BEGUN_NS
        sample = controller.sample(now_ns)
        np.testing.assert_allclose(sample.pose.position, recorded.pose.position, atol=1e-12)
        assert (sample.pose.rotation * recorded.pose.rotation.inv()).magnitude() < 1e-9
        assert (sample.trigger, sample.a) == (recorded.trigger, recorded.a)
        assert now_ns - sample.pose_ns == NS_PER_MS
        assert sample.buttons_ns == now_ns


@given(st.floats(0.0, 5.0))
def test_in_between_the_hand_glides_and_the_buttons_wait(place):
    controller = replay([reading(number) for number in range(6)])
    sample = controller.sample(LATER_NS + round(place * STEP_NS))
    assert sample.pose.position[0] == pytest.approx(0.001 * place, abs=1e-8)
    assert sample.pose.rotation.magnitude() == pytest.approx(0.01 * place, abs=1e-7)
    assert sample.a == (round(place * STEP_NS) >= 3 * STEP_NS)


def test_a_pose_that_had_stopped_coming_gets_old_again():
    last = reading(1)[1]
    frozen = [reading(n, pose=last.pose, pose_ns=last.pose_ns) for n in range(2, 6)]
    controller = replay([reading(0), reading(1), *frozen])
    now_ns = LATER_NS + 5 * STEP_NS
    assert now_ns - controller.sample(now_ns).pose_ns == 4 * STEP_NS + NS_PER_MS


def test_a_lost_pose_is_lost_again():
    lost = {"pose": None, "status": ControllerStatus.TRACKING_LOST, "pose_ns": BEGUN_NS}
    controller = replay([reading(0), reading(1), reading(2, **lost), reading(3)])
    before = controller.sample(LATER_NS + STEP_NS + STEP_NS // 2)
    assert before.status is ControllerStatus.OK
    assert before.pose.position[0] == pytest.approx(0.001)
    during = controller.sample(LATER_NS + 2 * STEP_NS + STEP_NS // 2)
    assert (during.status, during.pose) == (ControllerStatus.TRACKING_LOST, None)
    assert during.pose_ns == LATER_NS


def test_after_the_last_reading_everything_is_released_and_fresh():
    controller = replay([reading(number) for number in range(6)])
    now_ns = LATER_NS + 60 * STEP_NS
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
