"""What the session learns from each tick of the control loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tams_app.records import ArmState
from tams_app.runtime.clock import NS_PER_S
from tams_app.session.control import describe
from tams_app.session.signals import Signals
from tams_app.session.status import StatusBoard
from tams_app.session.stops import StopWatch
from tams_app.study.trial import Trial
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason

CONFIRM_AGAIN_NS = NS_PER_S


class Guard(Protocol):
    """Watches over the arm while it is armed."""

    def follow(self, arming: ArmingState, stopping: bool) -> None:
        """The arm's arming; `stopping`: it does not stand yet."""


class TickObserver:
    """Guard, trial, stops, notes and console follow the arm's arming. Never blocks.

    `arm_at_once` confirms in the operator's place, once a second until the arm was armed once.
    """

    def __init__(
        self,
        guard: Guard,
        trial: Trial,
        stops: StopWatch,
        board: StatusBoard,
        signals: Signals,
        note: Callable[[str, str], None],
        arm_at_once: bool,
    ) -> None:
        self._guard = guard
        self._trial = trial
        self._stops = stops
        self._board = board
        self._signals = signals
        self._note = note
        self._confirms = arm_at_once
        self._confirmed_ns: int | None = None
        self._arming = ArmingState.DISARMED

    def observe(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        """Take in one tick; in the control thread."""
        self._guard.follow(output.arming, output.stop)
        if output.arming is ArmingState.ENGAGED:
            self._trial.engaged(now_ns)
        if output.arming is not self._arming:
            self._arming = output.arming
            self._note_arming(output)
        if output.refusal and not self._confirms:
            self._note("warning", f"not confirmed: {output.refusal}")
        self._confirm(now_ns)
        self._stops.observe(now_ns, output, arm)
        self._board.tick(output, arm)

    def _confirm(self, now_ns: int) -> None:
        self._confirms = self._confirms and self._arming is ArmingState.DISARMED
        asked_ns = self._confirmed_ns
        if self._confirms and (asked_ns is None or now_ns - asked_ns > CONFIRM_AGAIN_NS):
            self._confirmed_ns = now_ns
            self._signals.confirm()

    def _note_arming(self, output: TeleopOutput) -> None:
        if output.reason is None:
            self._note("info", output.arming.value)
        else:
            self._note("warning", f"{output.arming.value}, {_advice(output, output.reason)}")


def _advice(output: TeleopOutput, reason: Reason) -> str:
    """What happened and what to do. A detail that is a sentence says both by itself."""
    told = describe(output)
    if not output.detail.endswith("."):
        return f"{told}. {reason.sentence}"
    return told if "confirm" in told else f"{told} Release the trigger, then confirm."
