"""The episodes of a live session: requests by key or controller, and their records in the log."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.recording.journal import Journal
from tams_app.records import ControllerStatus, EpisodeRequest, EpisodesState, Tick
from tams_app.robot.control import Signals
from tams_app.task.episodes import ARMED_NS, Episodes
from tams_app.units import NS_PER_S

HOLD_NS = NS_PER_S
_STATE_NS = NS_PER_S // 10
_COMPLETE = (
    f"all episodes are kept: the session ends in {ARMED_NS // NS_PER_S} s, once the deadman is "
    "released; the last can still be labelled or discarded"
)


class LongPress:
    """Reports once that a button was held for a second, of which all counted."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._is_over = True  # until it goes up

    def step(self, now_ns: int, is_down: bool, counts: bool) -> bool:
        """Take in whether it is down; True at the end of the second.

        `counts`: whether it means anything now; what was pressed while it did not has to go up.
        """
        if not (is_down and counts):
            self._since_ns, self._is_over = None, not counts
            return False
        if self._is_over:
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        self._is_over = now_ns - self._since_ns >= HOLD_NS
        return self._is_over


@dataclass(frozen=True, slots=True)
class Due:
    """What follows from a tick. scene: it is to be put back, before the countdown of an episode.

    end: all that are wanted are kept.
    """

    scene: bool
    end: bool


class EpisodeKeeper:
    """Lets episodes begin and end at ticks, and keeps each in the log when it ends.

    On the controller the buttons of the gripper, held for a second with the deadman released, when
    they move nothing: A stands for `NEXT`, B for `DISCARD`. All but `state` in the control thread.
    """

    def __init__(self, episodes: Episodes, signals: Signals, log: Journal) -> None:
        """`signals`: has what is asked by key."""
        self._episodes, self._signals, self._log = episodes, signals, log
        self._asked_ns = 0
        self._buttons = {EpisodeRequest.NEXT: LongPress(), EpisodeRequest.DISCARD: LongPress()}
        self.state: EpisodesState = self._episodes.state(0)
        self._state_due_ns = 0

    def step(self, tick: Tick) -> Due:
        """Take in a tick, and what was asked for since the last one."""
        now_ns = tick.started_ns
        begun = self._episodes.step(now_ns)
        requests = [*self._signals.episodes(), *self._held(tick)]
        if not requests and self._episodes.is_overdue(now_ns):
            requests = [EpisodeRequest.NEXT]
        if begun:
            self._log.note("info", begun)
        scene = end = False
        for request in requests:
            answer = self._episodes.ask(now_ns, request)
            if answer.record is not None:
                self._log.record(answer.record)
            self._log.note("info", answer.sentence)
            scene |= answer.begins
        if requests:
            self._asked_ns = now_ns
        if self._episodes.is_complete:
            if requests:
                self._log.note("info", _COMPLETE)
            else:
                end = not tick.deadman and now_ns - self._asked_ns >= ARMED_NS
        if begun or requests or now_ns >= self._state_due_ns:
            self._state_due_ns = now_ns + _STATE_NS
            self.state = self._episodes.state(now_ns)
        return Due(scene, end)

    def finish(self) -> None:
        """The control loop has ended: an episode that has not is none."""
        if sentence := self._episodes.close():
            self._log.note("warning", sentence)

    def _held(self, tick: Tick) -> list[EpisodeRequest]:
        sample = tick.controller
        is_known = sample.status is ControllerStatus.OK
        counts = is_known and not tick.deadman and not (sample.a and sample.b)
        down = {EpisodeRequest.NEXT: sample.a, EpisodeRequest.DISCARD: sample.b}
        return [
            request
            for request, button in self._buttons.items()
            if button.step(tick.started_ns, down[request], counts)
        ]
