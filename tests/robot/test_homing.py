"""The way to the ready pose: only while a key is held, and over when the arm is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hw.lite6.kinematics import HOME_JOINTS
from tams_app.config import Config, load_config
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmFault, ArmState, CommandLink, LinkFault, Pose
from tams_app.robot.homing import (
    Action,
    HeldKey,
    Homing,
    HomingInput,
    HomingState,
    path_to_ready,
)
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

GOAL = np.zeros(6)
AWAY = np.full(6, 0.5)
LINK = CommandLink(0, 0, 0, 0, "")
MS = NS_PER_MS


def pressed(*times_ms: float) -> HeldKey:
    key = HeldKey()
    for time_ms in times_ms:
        key.press(round(time_ms * MS))
    return key


def test_a_tap_holds_nothing() -> None:
    key = pressed(0)
    assert not any(key.held(at * MS) for at in (0, 1, 500, 700, 5000))


REPEATS_MS = (660, 700, 740, 780, 820, 860, 900, 940)


def test_a_held_key_is_held_once_it_repeats_and_until_a_quarter_second_after_its_last() -> None:
    key = pressed(0, *REPEATS_MS)
    assert not key.held(940 * MS)
    key.press(980 * MS)
    assert key.held(980 * MS)
    assert key.held(1230 * MS)
    assert not key.held(1231 * MS)


@pytest.mark.parametrize("taps_ms", [(0, 0), (0, 1, 2, 3), (0, 400, 600), (0, 150, 300, 420)])
def test_a_few_taps_hold_nothing(taps_ms: tuple[float, ...]) -> None:
    key = pressed(*taps_ms)
    assert not any(key.held(at * MS) for at in range(1000))


def test_two_presses_too_far_apart_are_two_taps() -> None:
    assert not pressed(0, 701).held(701 * MS)


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
        self.homing = Homing(GOAL)
        self.now_ns = NS_PER_S
        self.joints = AWAY
        self.activity = Activity.IDLE

    def arm(self, fault: ArmFault | None = None) -> ArmState:
        return ArmState(
            received_ns=self.now_ns,
            joints=self.joints,
            tcp=Pose(np.zeros(3), Rotation.identity()),
            activity=self.activity,
            servo=None,
            fault=fault,
            gripper_closed=None,
        )

    def step(self, pressed: bool = True, **changes: Any) -> Action:
        self.now_ns += 20 * MS
        tick = HomingInput(self.now_ns, pressed, False, self.arm(), LINK, guarded=True)
        return self.homing.step(replace(tick, **changes))

    def hold(self) -> Action:
        """Step with the key pressed until something is to be done."""
        for _ in range(100):
            if (action := self.step()) is not Action.NONE:
                return action
        raise AssertionError("nothing happens")

    def starting(self) -> Bench:
        assert self.hold() is Action.ARM
        assert self.step() is Action.START
        return self

    def moving(self) -> Bench:
        self.starting()
        self.activity = Activity.MOVING
        assert self.step(began=True) is Action.NONE
        assert self.homing.state is HomingState.MOVING
        return self


def test_nothing_moves_without_the_key() -> None:
    bench = Bench()
    assert {bench.step(pressed=False) for _ in range(100)} == {Action.NONE}
    assert bench.homing.state is HomingState.WAITING


def test_it_starts_once_however_long_starting_takes() -> None:
    bench = Bench()
    actions = [bench.step() for _ in range(100)]
    assert actions.count(Action.ARM) == actions.count(Action.START) == 1
    assert actions.index(Action.ARM) < actions.index(Action.START)
    assert bench.homing.state is HomingState.STARTING


def test_it_does_not_start_before_the_guard_has_said_that_it_watches() -> None:
    bench = Bench()
    assert bench.hold() is Action.ARM
    assert {bench.step(guarded=False) for _ in range(50)} == {Action.NONE}
    assert bench.step(guarded=True) is Action.START


def test_letting_go_before_the_guard_watches_starts_nothing() -> None:
    bench = Bench()
    assert bench.hold() is Action.ARM
    actions = {bench.step(pressed=False, guarded=False) for _ in range(50)}
    assert actions == {Action.NONE, Action.STOP}
    assert bench.homing.state is HomingState.WAITING
    assert bench.step(pressed=False, guarded=True) is Action.NONE


def test_letting_go_stops_within_a_quarter_second_and_holding_again_goes_on() -> None:
    bench = Bench().moving()
    steps = 0
    while bench.step(pressed=False) is Action.NONE:
        steps += 1
    assert steps * 20 <= 250
    assert bench.homing.state is HomingState.WAITING
    bench.activity = Activity.STOPPED
    bench.starting()


def test_letting_go_while_it_starts_stops_at_once_and_again_when_it_has_started() -> None:
    bench = Bench().starting()
    while bench.step(pressed=False) is not Action.STOP:
        assert bench.homing.state is HomingState.STARTING
    assert bench.step() is Action.NONE
    assert bench.step() is Action.NONE  # held again, but the start before is still under way
    assert bench.step(began=True) is Action.STOP
    assert bench.homing.state is HomingState.WAITING


def test_a_start_that_was_cancelled_and_refused_for_it_is_no_failure() -> None:
    bench = Bench().starting()
    while bench.step(pressed=False) is not Action.STOP:
        pass
    assert bench.step(pressed=False, refused="The arm was stopped meanwhile.") is Action.STOP
    assert bench.homing.state is HomingState.WAITING


def test_it_is_done_when_the_arm_stands_at_the_goal() -> None:
    bench = Bench().moving()
    bench.joints = GOAL
    assert bench.step() is Action.NONE  # there, but still moving
    bench.activity = Activity.IDLE
    assert bench.step() is Action.STOP
    assert bench.homing.state is HomingState.DONE
    assert bench.step() is Action.NONE


def test_an_arm_that_is_there_already_is_not_moved() -> None:
    bench = Bench()
    bench.joints = GOAL
    assert bench.step(pressed=False) is Action.STOP
    assert bench.homing.state is HomingState.DONE


@pytest.mark.parametrize("moving", [True, False])
def test_any_other_key_ends_it(moving: bool) -> None:
    bench = Bench().moving() if moving else Bench()
    assert bench.step(other_key=True) is Action.STOP
    assert bench.homing.state is HomingState.ENDED
    assert bench.step(pressed=True) is Action.NONE


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"refused": "The arm refused the move."}, "refused the move"),
        ({"link": replace(LINK, failure="Lost.", fault=LinkFault.LOST)}, "Lost"),
        ({"guard": "The guard is gone."}, "guard"),
        ({"arm": None}, "reporting"),
    ],
    ids=["refused", "link lost", "guard gone", "no reports"],
)
def test_what_goes_wrong_stops_the_arm_and_is_told(changes: dict[str, Any], reason: str) -> None:
    bench = Bench().moving()
    assert bench.step(**changes) is Action.STOP
    assert bench.homing.state is HomingState.FAILED
    assert reason in bench.homing.reason


def test_an_error_of_the_controller_is_told_with_its_number() -> None:
    bench = Bench().moving()
    assert bench.step(arm=bench.arm(ArmFault(31, "C31 (collision): remove it"))) is Action.STOP
    assert "C31" in bench.homing.reason


def test_reports_that_freeze_stop_the_arm() -> None:
    bench = Bench().moving()
    frozen = bench.arm()
    actions = [bench.step(arm=frozen) for _ in range(17)]
    assert actions.count(Action.STOP) == 1
    assert "reporting" in bench.homing.reason


def test_an_arm_that_was_stopped_from_elsewhere_is_not_started_again() -> None:
    bench = Bench().moving()
    bench.activity = Activity.STOPPED
    assert bench.step() is Action.STOP
    assert "from elsewhere" in bench.homing.reason


def test_a_report_from_before_the_start_is_not_taken_for_a_stop() -> None:
    bench = Bench()
    bench.activity = Activity.STOPPED
    bench.starting()
    old = bench.arm()
    bench.step(began=True)
    assert bench.step(arm=old) is Action.NONE


def test_an_arm_that_stands_still_on_its_way_is_a_failure() -> None:
    bench = Bench().moving()
    bench.activity = Activity.IDLE
    actions = [bench.step() for _ in range(60)]
    assert Action.STOP in actions
    assert "stands still" in bench.homing.reason


# --- the path -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(None)


def test_the_path_from_the_factorys_home_is_planned(config: Config) -> None:
    path = path_to_ready(config, HOME_JOINTS)
    np.testing.assert_allclose(np.degrees(path.goal), config.arm.ready_joints_deg)
    assert np.degrees(path.travel_rad) == pytest.approx(86.74 - 31.8, abs=0.1)
    assert 0.15 < path.tcp_path_m < 0.5
    assert path.lowest_m > 0.05
    assert path.duration_s(np.radians(10)) == pytest.approx(5.5, abs=0.1)


def test_a_path_that_dips_under_the_floor_is_refused(config: Config) -> None:
    above_the_floor = np.radians([0.0, 96.0, 12.0, 180.0, -24.0, 0.0])
    with pytest.raises(DeviceError, match=r"dip to -\d+ mm"):
        path_to_ready(config, above_the_floor)


def test_an_arm_that_is_under_the_floor_may_rise(config: Config) -> None:
    goal = np.radians(config.arm.ready_joints_deg)
    limits = config.limits.model_copy(update={"floor_mm": 200.0})  # above the ready pose even
    path = path_to_ready(config.model_copy(update={"limits": limits}), goal)
    assert path.travel_rad == 0.0


def test_a_path_passes_what_lies_on_it_and_nothing_else(config: Config) -> None:
    path = path_to_ready(config, HOME_JOINTS)
    way = path.goal - path.start
    aside = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    for fraction in (0.0, 0.4, 1.0):
        assert path.passes(path.start + fraction * way)
        assert not path.passes(path.start + fraction * way + aside)
    assert not path.passes(path.start - 0.1 * way)
    assert not path.passes(path.goal + 0.1 * way)


def test_the_path_of_an_arm_that_is_there_passes_only_there(config: Config) -> None:
    path = path_to_ready(config, np.radians(config.arm.ready_joints_deg))
    assert path.passes(path.goal)
    assert not path.passes(path.goal + 0.05)
