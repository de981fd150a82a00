"""The loop around the homing, in virtual time with the in-process arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hw.arm import Arm
from hw.arms import reach_boundary, session_boundary
from hw.guard.motion import Cause, Motion
from hw.lite6.kinematics import HOME_JOINTS
from hw.lite6.protocol import ErrorCode, State
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel, IdealPlant
from tams_app.config import Config, load_config
from tams_app.errors import DeviceError
from tams_app.records import ArmState, Vector
from tams_app.robot.control import Signals
from tams_app.robot.guarding import Guarding
from tams_app.robot.home_run import POLL_S, HomeRun
from tams_app.robot.homing import HomingState, advice_at_home
from tams_app.runtime.clock import VirtualClock
from tams_app.teleop.safety import Reason
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

REPEAT_NS = 40 * NS_PER_MS
FIRST_REPEAT_NS = 660 * NS_PER_MS


class WatchedLink:
    """Notes what the guard's process would get."""

    arm_lost = False

    def __init__(self) -> None:
        self.armings = 0
        self.armed = False
        self.beats: list[int] = []
        self.latched = False
        self.cause = Cause.NONE
        self.commanded: list[tuple[Motion, bool, float]] = []
        self.ended = False
        self.answers_after = 1  # beats of an arming
        self.beats_of_arming = 0

    @property
    def acknowledged(self) -> bool:
        return self.armed and self.beats_of_arming > self.answers_after

    def arm(self) -> None:
        self.armings += 1
        self.armed = True
        self.beats_of_arming = 0
        self.latched = False

    def disarm(self) -> None:
        self.armed = False

    def beat(self, now_ns: int, motion: Motion, deadman: bool, speed: float) -> None:
        self.beats.append(now_ns)
        self.commanded.append((motion, deadman, speed))
        self.beats_of_arming += self.armed

    def answers(self, now_ns: int) -> bool:
        return not (self.armed and self.ended)

    def is_fresh(self, now_ns: int) -> bool:
        return not self.ended


class Bench:
    """An operator who holds Enter as `held` says, at the factory's home."""

    def __init__(
        self, held: Callable[[float], bool], other: Callable[[float], bytes] | None = None
    ):
        self.config: Config = load_config(None)
        self.clock = VirtualClock()
        self.began_ns = self.clock.now_ns()
        self.model = ControllerModel(IdealPlant(), HOME_JOINTS)
        boundary = reach_boundary(self.config.arm, self.config.limits)
        self.arm = InProcessArm(self.config.arm, self.clock, self.model, boundary)
        self.signals = Signals()
        speed_rad_s = np.radians(self.config.arm.ready_speed_deg_s)
        self.guarding = Guarding(
            self.config.arm,
            self.config.limits,
            None,
            self.signals,
            lambda _level, text: self.said.append(text),
            speed_rad_s,
        )
        self.guard = WatchedLink()
        self.guarding._link = self.guard  # type: ignore[assignment]
        self.said: list[str] = []
        self.shown = True
        self.served_from_s = 0.0  # from when the gate has time for what is asked of it
        self._held, self._other = held, other
        self._next_press_ns = 0
        self._was_held = False
        self.every_step: Callable[[], None] = lambda: None
        self.arm.connect()

    def run(self) -> HomingState:
        run = HomeRun(self.config, self.clock, self.arm, self.guarding, self.signals)
        self.serve = run.gate.serve
        with run:
            self.said += run.sentences()
            while not run.over:
                keys = self._keys(POLL_S)
                self.said += run.step(keys, self.shown)
        return run.result

    def reports_joints(self, joints: Vector, when: Callable[[float], bool]) -> None:
        """The arm is at `joints` [rad] at the times that `when` tells."""
        report = self.arm.state

        def state() -> ArmState | None:
            true = report()
            if true is None or not when(self.elapsed_s()):
                return true
            return replace(true, joints=joints)

        self.arm.state = state  # type: ignore[method-assign]

    def elapsed_s(self) -> float:
        return (self.clock.now_ns() - self.began_ns) / NS_PER_S

    def _keys(self, timeout_s: float) -> bytes:
        """A terminal: one press when the key goes down, then its repeats."""
        assert self.elapsed_s() < 120.0, "it does not end"
        self.clock.advance_ns(round(timeout_s * NS_PER_S))
        self.arm.state()
        if self.elapsed_s() >= self.served_from_s:
            self.serve()
        self.every_step()
        if self._other is not None and (keys := self._other(self.elapsed_s())):
            return keys
        held, before = self._held(self.elapsed_s()), self._was_held
        self._was_held = held
        if not held:
            return b""
        now_ns = self.clock.now_ns()
        if not before:
            self._next_press_ns = now_ns + FIRST_REPEAT_NS
            return b"\n"
        if now_ns < self._next_press_ns:
            return b""
        self._next_press_ns = now_ns + REPEAT_NS
        return b"\n"


def test_from_the_factorys_home_to_the_ready_pose_at_the_configured_speed() -> None:
    bench = Bench(held=lambda _: True)
    fastest = [0.0]

    def measure() -> None:
        fastest[0] = max(fastest[0], float(np.abs(bench.model.joint_speeds).max()))

    bench.every_step = measure
    assert bench.run() is HomingState.DONE
    ready = np.radians(bench.config.arm.ready_joints_deg)
    np.testing.assert_allclose(bench.model.joints, ready, atol=1e-3)
    assert np.degrees(fastest[0]) == pytest.approx(10.0, abs=0.1)
    assert bench.model.state == State.STOPPED
    assert any("5" in line and "°" in line for line in bench.said)
    assert bench.said[-1] == "The arm is in its ready pose."


def test_the_guard_is_armed_before_the_arm_moves_and_beaten_all_the_way() -> None:
    bench = Bench(held=lambda _: True)
    bench.guard.answers_after = 5
    moved_unarmed = []
    bench.every_step = lambda: moved_unarmed.append(
        bench.model.moving and not bench.guard.acknowledged
    )
    bench.run()
    assert not any(moved_unarmed)
    assert bench.guard.armings == 1
    gaps_ms = np.diff(bench.guard.beats) / NS_PER_MS
    assert gaps_ms.max() < bench.config.arm.guard.heartbeat_timeout_ms / 2


def test_letting_go_stops_the_arm_and_holding_again_brings_it_home() -> None:
    bench = Bench(held=lambda at: not 2.0 < at < 4.0)
    stood = []

    def note() -> None:
        if 2.5 < bench.elapsed_s() < 4.0:
            stood.append(bench.model.joints)

    bench.every_step = note
    assert bench.run() is HomingState.DONE
    np.testing.assert_array_equal(stood[0], stood[-1])
    assert np.abs(stood[0] - HOME_JOINTS).max() > 0.1
    assert bench.guard.armings == 2


def test_a_tap_moves_nothing_and_escape_ends() -> None:
    bench = Bench(held=lambda at: 1.0 < at < 1.02, other=lambda at: b"\x1b" if at > 5.0 else b"")
    assert bench.run() is HomingState.ENDED
    np.testing.assert_array_equal(bench.model.joints, HOME_JOINTS)


@pytest.mark.parametrize("key", [b" ", b"\x1b", b"x", b"\x13", b"\nq"])
def test_any_other_key_stops_the_arm_on_its_way(key: bytes) -> None:
    bench = Bench(held=lambda _: True, other=lambda at: key if at > 3.0 else b"")
    assert bench.run() is HomingState.ENDED
    assert bench.model.state == State.STOPPED
    bench.clock.advance_ns(NS_PER_S)
    bench.arm.state()
    ready = np.radians(bench.config.arm.ready_joints_deg)
    assert np.abs(bench.model.joints - ready).max() > 0.1


@pytest.mark.parametrize(
    ("happens", "told"),
    [
        (lambda bench: bench.model.raise_error(ErrorCode.COLLISION), "C31"),
        (lambda bench: setattr(bench.guard, "ended", True), "guard"),
        (lambda bench: bench.clock.suspend_ns(NS_PER_S), "suspended"),
    ],
    ids=["an error", "no guard", "slept"],
)
def test_what_goes_wrong_on_the_way_stops_the_arm_and_is_told(
    happens: Callable[[Bench], None], told: str
) -> None:
    bench = Bench(held=lambda _: True)
    bench.every_step = lambda: happens(bench) if bench.elapsed_s() > 2.0 else None
    with pytest.raises(DeviceError, match=told):
        bench.run()
    assert bench.model.state == State.STOPPED


def test_a_failure_of_the_terminal_stops_the_arm() -> None:
    def disconnect(at: float) -> bytes:
        if at > 3.0:
            raise DeviceError("The terminal is gone.")
        return b""

    bench = Bench(held=lambda _: True, other=disconnect)
    with pytest.raises(DeviceError, match="terminal"):
        bench.run()
    assert bench.model.state == State.STOPPED


def test_a_refused_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(arm: Arm, joints: list[float], speed: float) -> None:
        raise DeviceError("The arm refused the move.")

    monkeypatch.setattr(InProcessArm, "begin_move_to_joints", refuse)
    bench = Bench(held=lambda _: True)
    with pytest.raises(DeviceError, match="refused the move"):
        bench.run()
    assert bench.model.state == State.STOPPED


def test_the_boundary_for_the_way_home_has_room_for_the_factorys_home() -> None:
    bench = Bench(held=lambda _: False)
    config = load_config(None)
    limits = config.limits.model_copy(update={"box_min_mm": (230.0, -250.0, 20.0)})
    position = bench.model.tcp[:3, 3]
    assert not session_boundary(config.arm, limits).contains(position)
    assert reach_boundary(config.arm, limits).contains(position)


def escape_at(
    end_s: float, keys: Callable[[float], bytes] = lambda _: b""
) -> Callable[[float], bytes]:
    """An operator who ends it with Esc, and does what `keys` says before."""
    return lambda at: b"\x1b" if at > end_s else keys(at)


def test_key_presses_that_piled_up_are_one_press() -> None:
    bench = Bench(
        held=lambda _: False,
        other=escape_at(3.0, lambda at: b"\r" * 50 if at < 0.1 or 0.5 < at < 0.52 else b""),
    )
    assert bench.run() is HomingState.ENDED
    assert bench.guard.armings == 0


def test_nothing_starts_before_the_path_can_be_read() -> None:
    bench = Bench(held=lambda _: True, other=escape_at(5.0))
    bench.shown = False
    assert bench.run() is HomingState.ENDED
    assert bench.guard.armings == 0
    np.testing.assert_array_equal(bench.model.joints, HOME_JOINTS)


def test_a_screen_that_shows_nothing_any_more_does_not_keep_a_released_key_from_stopping() -> None:
    bench = Bench(held=lambda at: at < 3.0, other=escape_at(6.0))
    stood = []

    def watch() -> None:
        bench.shown = bench.shown and not bench.model.moving
        if bench.elapsed_s() > 3.5:
            stood.append(not bench.model.moving)

    bench.every_step = watch
    assert bench.run() is HomingState.ENDED
    assert not bench.shown
    assert all(stood)


def test_without_the_guards_word_the_arm_never_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []
    monkeypatch.setattr(
        InProcessArm, "begin_move_to_joints", lambda _arm, _joints, speed: asked.append(speed)
    )
    bench = Bench(held=lambda _: True, other=escape_at(5.0))
    bench.guard.answers_after = 10**9
    assert bench.run() is HomingState.ENDED
    assert bench.guard.armings == 1
    assert asked == []


def test_the_first_beat_of_an_arming_comes_within_a_period() -> None:
    bench = Bench(held=lambda _: True)
    armed: list[tuple[int, int]] = []
    arm_guard = bench.guard.arm

    def arm() -> None:
        arm_guard()
        armed.append((bench.clock.now_ns(), len(bench.guard.beats)))

    bench.guard.arm = arm  # type: ignore[method-assign]
    bench.run()
    ((armed_ns, beats),) = armed
    assert bench.guard.beats[beats] - armed_ns <= POLL_S * NS_PER_S


def test_why_the_guard_stopped_the_arm_is_told_in_the_words_of_a_session() -> None:
    bench = Bench(held=lambda _: True)
    bench.guard.cause = Cause.TOO_FAST

    def latch() -> None:
        bench.guard.latched = bench.elapsed_s() > 3.0

    bench.every_step = latch
    with pytest.raises(DeviceError) as failed:
        bench.run()
    assert str(failed.value) == advice_at_home(Reason.ARM_TOO_FAST)
    assert bench.model.state == State.STOPPED


def test_a_start_that_was_cancelled_never_begins_and_the_next_one_need_not_wait_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The key is let go and held again while the arm has not begun to get ready."""
    begin = InProcessArm.begin_move_to_joints
    bench = Bench(held=lambda at: not 2.0 < at < 2.5)
    bench.served_from_s = 6.0
    begun_s: list[float] = []

    def note(arm: InProcessArm, joints: list[float], speed: float) -> None:
        begun_s.append(bench.elapsed_s())
        begin(arm, joints, speed)

    monkeypatch.setattr(InProcessArm, "begin_move_to_joints", note)
    assert bench.run() is HomingState.DONE
    assert bench.guard.armings == 2
    assert begun_s == [pytest.approx(6.0, abs=0.05)]


def test_an_arm_that_was_moved_by_hand_is_shown_its_new_path_before_it_moves() -> None:
    bench = Bench(held=lambda at: at > 2.0)
    aside = HOME_JOINTS + np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    bench.reports_joints(aside, lambda at: at < 1.0)
    paths_shown_s: list[float] = []
    moved_s: list[float] = []

    def watch() -> None:
        if len(paths_shown_s) < sum("joints now" in line for line in bench.said):
            paths_shown_s.append(bench.elapsed_s())
        if bench.model.moving:
            moved_s.append(bench.elapsed_s())

    bench.every_step = watch
    assert bench.run() is HomingState.DONE
    assert len(paths_shown_s) == 2
    assert moved_s[0] - paths_shown_s[1] > 0.3  # the key was held anew
    assert bench.guard.armings == 1


def test_between_two_presses_the_guard_leaves_an_arm_alone_that_stands() -> None:
    """It may be guided by hand then; the guard watches until the arm has reported its stop."""
    bench = Bench(held=lambda at: not 4.0 < at < 6.0)
    watched: list[tuple[float, bool, bool]] = []

    def watch() -> None:
        watched.append((bench.elapsed_s(), bench.model.moving, bench.guard.armed))

    bench.every_step = watch
    assert bench.run() is HomingState.DONE
    assert all(watches for _, moving, watches in watched if moving)
    assert {watches for at, _, watches in watched if 4.5 < at < 6.0} == {False}
    assert bench.guard.armings == 2


def test_an_arm_that_was_guided_to_where_its_path_dips_under_the_floor_does_not_start() -> None:
    bench = Bench(held=lambda at: at > 2.0)
    low = np.radians([0.0, 96.0, 12.0, 180.0, -24.0, 0.0])

    bench.reports_joints(low, lambda at: at > 1.0)
    with pytest.raises(DeviceError, match="dip"):
        bench.run()
    assert bench.guard.armings == 0


def test_a_move_that_begins_after_the_heartbeat_fell_silent_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = InProcessArm.begin_move_to_joints
    bench = Bench(held=lambda _: True)

    def late(arm: InProcessArm, joints: list[float], speed: float) -> None:
        begin(arm, joints, speed)
        assert bench.model.moving
        bench.clock.sleep_until_ns(bench.clock.now_ns() + NS_PER_S)

    monkeypatch.setattr(InProcessArm, "begin_move_to_joints", late)
    with pytest.raises(DeviceError, match="close other programs"):
        bench.run()
    assert bench.model.state == State.STOPPED


def test_a_beat_declares_the_motion_and_its_speed_while_the_key_is_held_and_no_longer() -> None:
    bench = Bench(held=lambda _: True)
    moved: list[tuple[bool, Motion]] = []

    def note() -> None:
        if bench.guard.commanded:
            moved.append((bench.model.moving, bench.guard.commanded[-1][0]))

    bench.every_step = note
    bench.run()
    # the move begins after a beat, so the next one is the first to declare it
    assert all(motion is Motion.HOME for (moving, _), (_, motion) in pairwise(moved) if moving)
    speed_rad_s = np.radians(bench.config.arm.ready_speed_deg_s)
    assert set(bench.guard.commanded) == {
        (Motion.REST, False, 0.0),
        (Motion.HOME, True, speed_rad_s),
    }
