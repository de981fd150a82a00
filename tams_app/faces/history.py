"""The last minute as the window draws it; pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import groupby, pairwise

from tams_app.faces.messages import FaceFacts, Stretch
from tams_app.records import SessionState

SPAN_S = 60.0


class History:
    """The states of the last SPAN_S seconds."""

    def __init__(self) -> None:
        self.states: deque[SessionState] = deque()
        self._jumps = 0

    def add(self, facts: FaceFacts) -> None:
        """Take in a newer state; one of the same moment changes nothing.

        Where a replay goes back, what came later is forgotten; where it jumps, the minute before
        is what its log has, or, if it does not tell, is forgotten after a jump ahead.
        """
        states, state, jumps = self.states, facts.state, _jumps(facts)
        jumped, self._jumps = jumps != self._jumps, jumps
        if states and state.t_s == states[-1].t_s:
            return
        if jumped and facts.replay is not None and facts.replay.past:
            states.clear()
            states.extend(facts.replay.past)
        elif states and state.t_s > states[-1].t_s and jumped:
            states.clear()
        while states and states[-1].t_s >= state.t_s:
            states.pop()
        states.append(state)
        while states[0].t_s < state.t_s - SPAN_S:
            states.popleft()

    def stretches(self, what: Callable[[SessionState], str]) -> list[Stretch]:
        """The times in which `what` stayed the same, one after the other."""
        begins = [next(group) for _, group in groupby(self.states, what)]
        changes = pairwise([*begins, *list(self.states)[-1:]])
        return [Stretch(begin.t_s, end.t_s, what(begin)) for begin, end in changes]

    def curve(self, value: Callable[[SessionState], float | None]) -> list[tuple[float, float]]:
        """A value over time [s], where it is known."""
        points = ((state.t_s, value(state)) for state in self.states)
        return [(t_s, known) for t_s, known in points if known is not None]


def _jumps(facts: FaceFacts) -> int:
    return 0 if facts.replay is None else facts.replay.jumps
