"""The whole of a log in a few stretches, for the bar that shows where a replay is; pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from tams_app.faces.messages import Outline, Stretch
from tams_app.recording import SessionLog
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

CELLS = 600  # that a log is divided into, however long it is: each about two pixels wide
_SEVERITY = {state.value: number for number, state in enumerate(ArmingState)}


def outline_of(log: SessionLog) -> Outline:
    """Phases and states of `log`. A stop is in it however short it was."""
    start_ns = log.header.started_ns
    length_ns = max(log.ended_ns - start_ns, 1)

    def cell_of(t_ns: int) -> int:
        return min(max((t_ns - start_ns) * CELLS // length_ns, 0), CELLS - 1)

    phases, states = [""] * CELLS, [""] * CELLS
    for change in log.phases:
        phases[cell_of(change.t_ns)] = change.phase.value
    for tick in log.ticks:
        cell = cell_of(tick.started_ns)
        states[cell] = max(states[cell], tick.arming, key=lambda state: _SEVERITY.get(state, -1))
    cell_s = length_ns / CELLS / NS_PER_S
    return Outline(length_ns / NS_PER_S, _stretches(phases, cell_s), _stretches(states, cell_s))


def _stretches(words: Sequence[str], cell_s: float) -> tuple[Stretch, ...]:
    """Cells of the same word as one; a cell without any has that of the one before it."""
    changes: list[tuple[int, str]] = []
    for cell, word in enumerate(words):
        if word and (not changes or word != changes[-1][1]):
            changes.append((cell, word))
    changes.append((len(words), ""))
    return tuple(
        Stretch(begin * cell_s, end * cell_s, word) for (begin, word), (end, _) in pairwise(changes)
    )
