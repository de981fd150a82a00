"""The hand of an earlier session on the controller: the same motion again, in open loop."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hw.controller import Controller
from tams_app.errors import ConfigError
from tams_app.recording import read_ticks
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose


def recorded_hand(log: Path) -> ReplayedController:
    """A controller that moves as the one in `log` did; LogError if that is none of ours."""
    readings = [(tick.started_ns, tick.controller) for tick in read_ticks(log)]
    if not readings:
        raise ConfigError(
            f"rig.hand_trajectory: {log} holds no tick of a hand: name a session that ran"
        )
    return ReplayedController(readings)


class ReplayedController(Controller):
    """Plays `readings` back, at least one: when each was taken [ns], ascending, and its content.

    The first call of `sample` stands for the first reading. Between two readings the hand moves
    evenly from the one to the other and the buttons are those of the earlier; what was old then is
    as old now. After the last it holds still with everything released. No clock, no randomness.
    """

    def __init__(self, readings: Sequence[tuple[int, ControllerSample]]) -> None:
        self._times_ns = [t_ns for t_ns, _ in readings]
        self._samples = [sample for _, sample in readings]
        self._shift_ns: int | None = None  # from then to now
        self._started = False

    def start(self) -> None:
        """There is nothing to connect to."""
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        if not self._started:
            away = ControllerStatus.DISCONNECTED
            return replace(_released(self._samples[0], now_ns), status=away, pose=None)
        if self._shift_ns is None:
            self._shift_ns = now_ns - self._times_ns[0]
        then_ns = now_ns - self._shift_ns
        place = bisect_right(self._times_ns, then_ns) - 1
        if place + 1 >= len(self._samples) and then_ns > self._times_ns[-1]:
            return _released(self._samples[-1], now_ns)
        return self._between(max(0, place), then_ns, self._shift_ns)

    def pulse(self, haptic: Haptic) -> None:
        """A recorded hand feels nothing."""

    def close(self) -> None:
        """There is nothing to let go of."""
        self._started = False

    def _between(self, place: int, then_ns: int, shift_ns: int) -> ControllerSample:
        before = self._samples[place]
        after = self._samples[min(place + 1, len(self._samples) - 1)]
        start_ns = self._times_ns[place]
        span_ns = self._times_ns[min(place + 1, len(self._samples) - 1)] - start_ns
        part = (then_ns - start_ns) / span_ns if span_ns > 0 else 0.0
        interpolates = before.pose is not None and after.pose is not None
        return replace(
            before,
            pose=_interpolated(before.pose, after.pose, part),
            pose_ns=shift_ns + _mix(before.pose_ns, after.pose_ns, part if interpolates else 0.0),
            buttons_ns=shift_ns + _mix(before.buttons_ns, after.buttons_ns, part),
        )


def _released(sample: ControllerSample, now_ns: int) -> ControllerSample:
    return replace(
        sample, pose_ns=now_ns, buttons_ns=now_ns, trigger=0.0, grip=0.0, a=False, b=False,
        menu=False,
    )  # fmt: skip


def _mix(before_ns: int, after_ns: int, part: float) -> int:
    return before_ns + round(part * (after_ns - before_ns))


def _interpolated(before: Pose | None, after: Pose | None, part: float) -> Pose | None:
    """The pose `part` of the way, 0 to 1, on the shortest turn; `before` where one is not known."""
    if before is None or after is None or part == 0.0:
        return before
    turn = [part * angle for angle in before.rotation.turn_to(after.rotation)]
    return Pose(
        before.position + part * (after.position - before.position),
        before.rotation.turned(turn),
    )
