"""What the window remembers of the last minute, to draw it; pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from tams_app.console.window.messages import Facts, Stretch

SPAN_S = 60.0


class History:
    """The facts of the last SPAN_S seconds."""

    def __init__(self) -> None:
        self.facts: deque[Facts] = deque()
        self._jumps = 0

    def add(self, facts: Facts) -> None:
        """Take in newer facts; those of the same moment change nothing.

        Where a replay goes back, what came later is forgotten; where it jumps ahead, all is: of
        the time between nothing is known.
        """
        if self.facts and facts.t_s == self.facts[-1].t_s:
            self._jumps = _jumps(facts)
            return
        if self.facts and facts.t_s > self.facts[-1].t_s and _jumps(facts) != self._jumps:
            self.facts.clear()
        while self.facts and self.facts[-1].t_s >= facts.t_s:
            self.facts.pop()
        self._jumps = _jumps(facts)
        self.facts.append(facts)
        while self.facts[0].t_s < facts.t_s - SPAN_S:
            self.facts.popleft()

    def phases(self) -> list[Stretch]:
        """The phases, one after the other."""
        return list(self._stretches(lambda facts: facts.phase))

    def armings(self) -> list[Stretch]:
        """The states of the arming table, one after the other."""
        return list(self._stretches(lambda facts: facts.arming))

    def curve(self, value: Callable[[Facts], float | None]) -> list[tuple[float, float]]:
        """A value over time [s], where it is known."""
        points = ((facts.t_s, value(facts)) for facts in self.facts)
        return [(t_s, known) for t_s, known in points if known is not None]

    def _stretches(self, what: Callable[[Facts], str]) -> Iterator[Stretch]:
        begin: Facts | None = None
        for facts in self.facts:
            if begin is None:
                begin = facts
            elif what(facts) != what(begin):
                yield Stretch(begin.t_s, facts.t_s, what(begin))
                begin = facts
        if begin is not None:
            yield Stretch(begin.t_s, self.facts[-1].t_s, what(begin))


def _jumps(facts: Facts) -> int:
    return 0 if facts.replay is None else facts.replay.jumps
