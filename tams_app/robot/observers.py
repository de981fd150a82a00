"""A session's conclusions from each tick: advice for the operator, and stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tams_app.records import ArmState, Note, Record, StopRecord
from tams_app.robot.control import Signals, describe, lasting_label
from tams_app.teleop.hands import words_of_hand
from tams_app.teleop.reasons import advice, refusal
from tams_app.teleop.records import TeleopInput, TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_S
from tams_app.vectors import floats, norm

CONFIRM_AGAIN_NS = NS_PER_S
HOT_ADVICE = "bring the arm to its ready pose and let it rest before it stops by itself"
HOTTER_C = 5.0
STANDING_M_S = 0.001
TRIAL_RATE_HZ = 30.0
_MIN_INTERVAL_S = 0.002
_STOPPING = (ArmingState.HOLDING, ArmingState.FAULT)


class ArmingNotes:
    """Sentences for the operator: the arm's arming, and confirmations that do not count.

    `arm_at_once` confirms in the operator's place, once a second until the arm was armed once.
    """

    def __init__(self, signals: Signals, hand: Callable[[], str], arm_at_once: bool) -> None:
        """`hand`: what drives the arm now, of `HANDS`."""
        self._signals = signals
        self._hand = hand
        self._confirms = arm_at_once
        self._confirmed_ns: int | None = None
        self._arming = ArmingState.DISARMED

    def step(self, inputs: TeleopInput, output: TeleopOutput) -> list[Record]:
        notes: list[Record] = []
        if output.arming is not self._arming:
            self._arming = output.arming
            notes.append(self._note(inputs.now_ns, output))
        if output.refusal is not None and not self._confirms:
            why = refusal(output.refusal.in_the_way, words_of_hand(self._hand()))
            notes.append(Note(inputs.now_ns, "warning", f"not confirmed: {why}"))
        self._confirm(inputs.now_ns)
        return notes

    def _confirm(self, now_ns: int) -> None:
        self._confirms = self._confirms and self._arming is ArmingState.DISARMED
        asked_ns = self._confirmed_ns
        if self._confirms and (asked_ns is None or now_ns - asked_ns > CONFIRM_AGAIN_NS):
            self._confirmed_ns = now_ns
            self._signals.confirm(now_ns)

    def _note(self, now_ns: int, output: TeleopOutput) -> Note:
        if output.reason is None:
            return Note(now_ns, "info", output.arming.value)
        sentence = advice(describe(output), lasting_label(output), words_of_hand(self._hand()))
        return Note(now_ns, "warning", f"{output.arming.value}, {sentence}")


class HeatWatch:
    """Warns the operator of a hot motor of the arm, and again whenever it is 5 °C hotter."""

    def __init__(self, hot_c: float) -> None:
        """`hot_c`: `ArmLimits.hot_motor_c`."""
        self._hot_c = hot_c

    def step(self, inputs: TeleopInput, output: TeleopOutput) -> list[Record]:
        hottest_c = None if inputs.arm is None else inputs.arm.hottest_motor_c
        if hottest_c is None or hottest_c < self._hot_c:
            return []
        self._hot_c = hottest_c + HOTTER_C
        text = f"a motor of the arm has {hottest_c} °C: {HOT_ADVICE}"
        return [Note(inputs.now_ns, "warning", text)]


class StopWatch:
    """Measures how long the arm takes to stand still after a stop that was not the operator's own.

    Each gives one `StopRecord`.
    """

    def __init__(self) -> None:
        self._before = ArmingState.DISARMED
        self._reason: Reason | None = None
        self._visible_ns = 0
        self._last: ArmState | None = None

    def step(self, inputs: TeleopInput, output: TeleopOutput) -> list[Record]:
        arm = inputs.arm
        speed = self._reported_speed(arm)
        began = output.arming in _STOPPING and self._before not in _STOPPING
        self._before = output.arming
        if began and output.reason is not None:
            unfinished = self.finish()
            self._reason, self._visible_ns = output.reason, inputs.now_ns
            return unfinished
        standing = speed is not None and speed < STANDING_M_S
        if self._reason is not None and standing and arm and arm.received_ns > self._visible_ns:
            return self._over(arm.received_ns)
        return []

    def finish(self) -> list[Record]:
        """A stop whose end was not seen, if there is one."""
        return [] if self._reason is None else self._over(None)

    def _over(self, stopped_ns: int | None) -> list[Record]:
        assert self._reason is not None, "a stop is measured"
        stop = StopRecord(self._reason.label, self._visible_ns, stopped_ns)
        self._reason = None
        return [stop]

    def _reported_speed(self, arm: ArmState | None) -> float | None:
        """TCP speed [m/s] between this report and the last one; None without a new one."""
        last = self._last
        if arm is None or last is None:
            self._last = arm
            return None
        interval_s = (arm.received_ns - last.received_ns) / NS_PER_S
        if interval_s < _MIN_INTERVAL_S:
            return None
        self._last = arm
        return norm(floats(arm.tcp.position - last.tcp.position)) / interval_s


@dataclass(frozen=True, slots=True)
class TrialLook:
    """What a look at a trial has found.

    placed: the block is, since the last look. over: the trial ends.
    """

    placed: bool = False
    over: bool = False
