"""The way to the ready pose: only while a key is held, and over when the arm is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hw.lite6.kinematics import HOME_JOINTS
from tams_app.config import load_config
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmState, CommandLink, LinkFault, Pose
from tams_app.robot.control import Signals
from tams_app.robot.home_run import EnterKey
from tams_app.robot.homing import HeldKey, Homing, HomingState, advice_at_home, path_to_ready
from tams_app.rotation import Rotation
from tams_app.teleop.records import TeleopInput, TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason, Request
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

CONFIG = load_config(None)
LINK = CommandLink(0, 0, 0, 0, "")
MS = NS_PER_MS


def pressed(*times_ms: float) -> HeldKey:
    key = HeldKey()
    for time_ms in times_ms:
        key.press(round(time_ms * MS))
    return key


REPEATS_MS = (660, 700, 740, 780, 820, 860, 900, 940)


def test_a_held_key_is_held_once_it_repeats_and_until_a_quarter_second_after_its_last() -> None:
    key = pressed(0, *REPEATS_MS)
    assert not key.held(940 * MS)
    key.press(980 * MS)
    assert key.held(980 * MS)
    assert key.held(1230 * MS)
    assert not key.held(1231 * MS)


@pytest.mark.parametrize(
    "taps_ms", [(0,), (0, 0), (0, 1, 2, 3), (0, 400, 600), (0, 150, 300, 420), (0, 701)]
)
def test_a_few_taps_hold_nothing(taps_ms: tuple[float, ...]) -> None:
    key = pressed(*taps_ms)
    assert not any(key.held(at * MS) for at in range(1000))


def test_after_a_release_holding_begins_anew() -> None:
    key = pressed(0, *REPEATS_MS, 980, 1300)
    assert not key.held(1300 * MS)
    for at in (1900, 1990, 2080, 2170):
        key.press(at * MS)
        assert not key.held(at * MS)
    key.press(2260 * MS)
    assert key.held(2260 * MS)


# --- the machine --------------------------------------------------------------------------------


class Bench:
    """A homing at 50 steps a second, with an arm that is where the test says."""

    def __init__(self) -> None:
        self.guarded = True
        self.ready = False  # the move is under way
        self.homing = Homing(CONFIG, HOME_JOINTS, lambda _: self.guarded)
        self.now_ns = NS_PER_S
        self.joints = HOME_JOINTS
        self.activity = Activity.IDLE

    @property
    def state(self) -> HomingState:
        return self.homing.state

    def arm(self) -> ArmState:
        return ArmState(
            received_ns=self.now_ns,
            joints=self.joints,
            tcp=Pose(np.zeros(3), Rotation.identity()),
            activity=self.activity,
            servo=None,
            fault=None,
            gripper_closed=None,
        )

    def step(self, pressed: bool = True, **changes: Any) -> TeleopOutput:
        self.now_ns += 20 * MS
        self.homing.all_shown = True
        key = EnterKey(Signals())
        key.feed(b"\r" if pressed else b"")
        told = TeleopInput(
            now_ns=self.now_ns,
            sample=key.sample(self.now_ns),
            arm=self.arm(),
            link=LINK,
            arm_ready=self.ready,
            video_age_ns=0,
            confirm=False,
            estop=False,
        )
        return self.homing.step(replace(told, **changes))

    def hold(self) -> Bench:
        """Step with the key pressed until the guard is armed."""
        for _ in range(100):
            if self.step().arming is ArmingState.READY:
                return self
        raise AssertionError("nothing happens")

    def starting(self) -> Bench:
        assert self.hold().step().request is Request.ENABLE
        return self

    def moving(self) -> Bench:
        self.starting()
        self.activity, self.ready = Activity.MOVING, True
        assert not self.step().stop
        assert self.state is HomingState.MOVING
        return self

    def release(self) -> int:
        """Let go until it stops: how many steps later that is."""
        for steps in range(100):
            if self.step(pressed=False).stop:
                self.ready = False
                return steps
        raise AssertionError("it does not stop")


def test_nothing_moves_without_the_key() -> None:
    bench = Bench()
    outputs = [bench.step(pressed=False) for _ in range(100)]
    assert {output.request for output in outputs} == {Request.NONE}
    assert {output.arming for output in outputs} == {ArmingState.DISARMED}
    assert bench.state is HomingState.WAITING


def test_it_starts_once_however_long_starting_takes() -> None:
    bench = Bench()
    outputs = [bench.step() for _ in range(100)]
    arming = [output.arming for output in outputs]
    requests = [output.request for output in outputs]
    assert requests.count(Request.ENABLE) == 1
    assert arming.index(ArmingState.READY) < requests.index(Request.ENABLE)
    assert bench.state is HomingState.STARTING


def test_it_does_not_start_before_the_guard_has_said_that_it_watches() -> None:
    bench = Bench().hold()
    bench.guarded = False
    assert {bench.step().request for _ in range(50)} == {Request.NONE}
    bench.guarded = True
    assert bench.step().request is Request.ENABLE


def test_letting_go_before_the_guard_watches_starts_nothing() -> None:
    bench = Bench().hold()
    bench.guarded = False
    bench.release()
    assert bench.state is HomingState.WAITING
    bench.guarded = True
    assert bench.step(pressed=False).request is Request.NONE


def test_letting_go_stops_within_a_quarter_second_and_holding_again_goes_on() -> None:
    bench = Bench().moving()
    assert bench.release() * 20 <= 250
    assert bench.state is HomingState.WAITING
    bench.activity = Activity.STOPPED
    bench.starting()


def test_after_a_release_nothing_starts_before_the_arm_has_reported_that_it_stopped() -> None:
    bench = Bench().moving()
    bench.release()
    outputs = [bench.step() for _ in range(100)]
    assert all(output.stop for output in outputs)
    assert {output.arming for output in outputs} == {ArmingState.DISARMED}
    bench.activity = Activity.STOPPED
    bench.starting()


def test_letting_go_while_it_starts_stops_at_once_and_no_start_is_taken_for_the_next() -> None:
    bench = Bench().starting()
    bench.release()
    assert bench.state is HomingState.WAITING
    bench.activity = Activity.STOPPED
    bench.starting()
    assert {bench.step().request for _ in range(20)} == {Request.NONE}
    assert bench.state is HomingState.STARTING


def test_a_refusal_from_before_a_start_is_none_of_it() -> None:
    bench = Bench().starting()
    bench.release()
    bench.homing.refusal = "The arm was stopped meanwhile."
    bench.activity = Activity.STOPPED
    bench.starting()


def test_it_is_done_when_the_arm_stands_at_the_goal() -> None:
    bench = Bench().moving()
    bench.joints = bench.homing.path.goal
    assert not bench.step().stop  # there, but still moving
    bench.activity = Activity.IDLE
    assert bench.step().stop
    assert bench.state is HomingState.DONE
    assert bench.step().request is Request.NONE


def test_an_arm_that_is_there_already_is_not_moved() -> None:
    bench = Bench()
    bench.joints = bench.homing.path.goal
    assert bench.step(pressed=False).stop
    assert bench.state is HomingState.DONE


GONE = replace(LINK, failure="Lost.", fault=LinkFault.LOST)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"link": GONE}, "Lost"),
        ({"faults": (Reason.GUARD_LOST,)}, "guard"),
        ({"faults": (Reason.GUARD_STOPPED,), "link": GONE}, "guard"),
        ({"faults": (Reason.COMPUTER_SLEPT,)}, "suspended"),
        ({"arm": None}, "reports"),
    ],
    ids=["link lost", "guard gone", "guard before what follows", "slept", "no reports"],
)
def test_what_goes_wrong_stops_the_arm_and_is_told(changes: dict[str, Any], reason: str) -> None:
    bench = Bench().moving()
    assert bench.step(**changes).stop
    assert bench.state is HomingState.FAILED
    assert reason in bench.homing.failure


def test_reports_that_freeze_stop_the_arm_as_early_as_in_a_session() -> None:
    bench = Bench().moving()
    frozen, began_ns = bench.arm(), bench.now_ns
    while not bench.step(arm=frozen).stop:
        pass
    assert bench.now_ns - began_ns == pytest.approx(CONFIG.freshness.arm_state_ms * MS, abs=20 * MS)
    assert "reports are late" in bench.homing.failure


def test_while_the_arm_reports_late_nothing_starts_and_once_it_is_silent_it_is_over() -> None:
    bench = Bench()
    frozen = bench.arm()
    for _ in range(50):
        assert bench.step(arm=frozen).arming is ArmingState.DISARMED
    assert bench.step(arm=frozen).stop
    assert "stopped reporting" in bench.homing.failure


def test_an_arm_that_was_stopped_from_elsewhere_is_not_started_again() -> None:
    bench = Bench().moving()
    bench.activity = Activity.STOPPED
    assert bench.step().stop
    assert "from elsewhere" in bench.homing.failure


def test_a_report_from_before_the_start_is_not_taken_for_a_stop() -> None:
    bench = Bench()
    bench.activity = Activity.STOPPED
    bench.starting()
    old, bench.ready = bench.arm(), True
    assert not bench.step().stop
    assert not bench.step(arm=old).stop


def test_an_arm_that_stands_still_on_its_way_is_a_failure() -> None:
    bench = Bench().moving()
    bench.activity = Activity.IDLE
    assert any(bench.step().stop for _ in range(60))
    assert "stands still" in bench.homing.failure


@pytest.mark.parametrize("reason", list(Reason))
def test_what_to_do_fits_a_command_that_has_ended(reason: Reason) -> None:
    words = advice_at_home(reason)
    for foreign in ("confirm", "session again", "{", "trigger", "Shift"):
        assert foreign not in words


# --- the path -----------------------------------------------------------------------------------


def test_the_path_from_the_factorys_home_is_planned() -> None:
    path = path_to_ready(CONFIG, HOME_JOINTS)
    np.testing.assert_allclose(np.degrees(path.goal), CONFIG.arm.ready_joints_deg)
    assert np.degrees(path.travel_rad) == pytest.approx(86.74 - 31.8, abs=0.1)
    assert 0.15 < path.tcp_path_m < 0.5
    assert path.lowest_m > 0.05
    assert path.duration_s(np.radians(10)) == pytest.approx(5.5, abs=0.1)


def test_a_path_that_dips_under_the_floor_is_refused() -> None:
    above_the_floor = np.radians([0.0, 96.0, 12.0, 180.0, -24.0, 0.0])
    with pytest.raises(DeviceError, match=r"dip to -\d+ mm"):
        path_to_ready(CONFIG, above_the_floor)


def test_an_arm_that_is_under_the_floor_may_rise() -> None:
    goal = np.radians(CONFIG.arm.ready_joints_deg)
    limits = CONFIG.limits.model_copy(update={"floor_mm": 200.0})  # above the ready pose even
    path = path_to_ready(CONFIG.model_copy(update={"limits": limits}), goal)
    assert path.travel_rad == 0.0


def test_a_path_passes_what_lies_on_it_and_nothing_else() -> None:
    path = path_to_ready(CONFIG, HOME_JOINTS)
    way = path.goal - path.start
    aside = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    for fraction in (0.0, 0.4, 1.0):
        assert path.passes(path.start + fraction * way)
        assert not path.passes(path.start + fraction * way + aside)
    assert not path.passes(path.start - 0.1 * way)
    assert not path.passes(path.goal + 0.1 * way)


def test_the_path_of_an_arm_that_is_there_passes_only_there() -> None:
    path = path_to_ready(CONFIG, np.radians(CONFIG.arm.ready_joints_deg))
    assert path.passes(path.goal)
    assert not path.passes(path.goal + 0.05)
