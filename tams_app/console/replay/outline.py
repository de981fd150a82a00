"""The whole of a log in a few stretches, for the bar that shows where a replay is; pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

from tams_app.faces.messages import Outline, Stretch
from tams_app.recording import SessionLog
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

CELLS = 600  # that a log is divided into, however long it is: each about two pixels wide
_SEVERITY = {state.value: number for number, state in enumerate(ArmingState)}


def outline_of(log: SessionLog) -> Outline:
    """Phases and states of `log`. A stop is in it however short it was."""
    start_ns, length_ns = log.header.started_ns, _length_ns(log)
    states = [""] * CELLS
    for tick in log.ticks:
        cell = _cell(tick.started_ns - start_ns, length_ns)
        states[cell] = max(states[cell], tick.arming, key=lambda state: _SEVERITY.get(state, -1))
    changes = ((change.t_ns - start_ns, change.phase.value) for change in log.phases)
    return Outline(length_ns / NS_PER_S, phases_row(log, changes), _stretches(states, length_ns))


def phases_row(log: SessionLog, changes: Iterable[tuple[int, str]]) -> tuple[Stretch, ...]:
    """Phases over the length of `log`, by when each begins [ns since its start], in order."""
    length_ns = _length_ns(log)
    words = [""] * CELLS
    for since_ns, word in changes:
        words[_cell(since_ns, length_ns)] = word
    return _stretches(words, length_ns)


def _length_ns(log: SessionLog) -> int:
    return max(log.ended_ns - log.header.started_ns, 1)


def _cell(since_ns: int, length_ns: int) -> int:
    return min(max(since_ns * CELLS // length_ns, 0), CELLS - 1)


def _stretches(words: Sequence[str], length_ns: int) -> tuple[Stretch, ...]:
    """Cells of the same word as one; a cell without any has that of the one before it."""
    cell_s = length_ns / CELLS / NS_PER_S
    changes: list[tuple[int, str]] = []
    for cell, word in enumerate(words):
        if word and (not changes or word != changes[-1][1]):
            changes.append((cell, word))
    changes.append((len(words), ""))
    return tuple(
        Stretch(begin * cell_s, end * cell_s, word) for (begin, word), (end, _) in pairwise(changes)
    )
