"""The console's display at any moment of a log, and the whole of it in a few stretches; pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tams_app.faces.messages import SPAN_S, Outline, Stretch
from tams_app.policy.weights import WeightMatrix
from tams_app.recording import SessionLog
from tams_app.recording.topics import FrameShown
from tams_app.records import EpisodesState, Newest, Note, Placed, Record, SessionState, ViewState
from tams_app.robot.status import WINDOW_NS
from tams_app.state import StateMaker
from tams_app.summary.tables import Integers, known_packets
from tams_app.task.episodes import shown_episodes
from tams_app.task.judge import PLACED
from tams_app.teleop.hands import HAND_FACT
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.uplink_figures import uplink_figures

CELLS = 600  # that a log is divided into, however long it is: each about two pixels wide
_SEVERITY = {state.value: number for number, state in enumerate(ArmingState)}
T = TypeVar("T")


class LogIndex:
    """A log by time; `at` gives the state of a moment, `notes_between` the notices."""

    def __init__(self, log: SessionLog) -> None:
        self._log = log
        self._views = log.header.views
        stops = sorted(log.stops, key=lambda stop: stop.visible_ns)
        # a log without the record has it in words alone
        placed = log.placed or [
            Placed(one.t_ns, placed=True) for one in log.notes if one.text.startswith(PLACED)
        ]
        self._records: list[tuple[Sequence[Record], Integers]] = [
            (log.ticks, _times([tick.started_ns for tick in log.ticks])),
            (stops, _times([stop.visible_ns for stop in stops])),
            *(
                (timed, _times([one.t_ns for one in timed]))
                for timed in (
                    log.allocations,
                    log.phases,
                    log.pins,
                    log.capacities,
                    log.rates,
                    placed,
                )
            ),
        ]
        self._rates: dict[int, SessionState] = {}  # by time, as they are asked for
        captured: dict[str, dict[int, int]] = {view: {} for view in self._views}
        for frame in log.captured:
            if frame.view in captured:  # a foreign log may have others
                captured[frame.view][frame.index] = frame.capture_ns
        self._captured_ns = {
            view: np.sort(_times([*known.values()])) for view, known in captured.items()
        }
        self._shown = {
            view: _ShownFrames.of([one for one in log.shown if one.view == view], captured[view])
            for view in self._views
        }
        self._packets = sorted(known_packets(log), key=lambda one: one.entered_ns)
        self._entered_ns = _times([packet.entered_ns for packet in self._packets])
        weights = WeightMatrix(log.header.weights) if log.header.weights else None
        self._maker = StateMaker(self._views, weights, log.header.fps)

    def at(self, t_ns: int) -> SessionState:
        """The state as the console had it at `t_ns`."""
        log = self._log
        found = [_last(records, times_ns, t_ns) for records, times_ns in self._records]
        since, until = np.searchsorted(self._entered_ns, (t_ns - WINDOW_NS, t_ns))
        return self._maker.state(
            Newest(found),
            t_s=(t_ns - log.header.started_ns) / NS_PER_S,
            figures=uplink_figures(self._packets[since:until], self._views, WINDOW_NS),
            views={view: self._view(view, t_ns) for view in self._views},
            hand=log.facts.get(HAND_FACT, ""),
            episodes=self._episodes(t_ns) if log.episodes else None,
        )

    def rates_before(self, t_ns: int) -> tuple[SessionState, ...]:
        """The last minute before `t_ns`, a state at each whole second with the rates alone."""
        start_ns = self._log.header.started_ns
        last_s = (t_ns - start_ns) // NS_PER_S
        first_s = max(last_s - round(SPAN_S), 0)
        return tuple(self._rates_at(start_ns + s * NS_PER_S) for s in range(first_s, last_s + 1))

    def _rates_at(self, t_ns: int) -> SessionState:
        if t_ns not in self._rates:
            state = self.at(t_ns)
            views = {
                name: ViewState(target_kbps=view.target_kbps, sent_kbps=view.sent_kbps)
                for name, view in state.views.items()
            }
            self._rates[t_ns] = SessionState(
                t_s=state.t_s, arming=state.arming, views=views, estimate_kbps=state.estimate_kbps
            )
        return self._rates[t_ns]

    def notes_between(self, after_ns: int, until_ns: int) -> list[Note]:
        """The sentences later than `after_ns` and not after `until_ns`."""
        return [note for note in self._log.notes if after_ns < note.t_ns <= until_ns]

    def _episodes(self, t_ns: int) -> EpisodesState:
        """The episodes that have ended, by their newest verdict, and the one being recorded."""
        known = self._log.judged_episodes
        ended = [one for one in known if one.end_ns <= t_ns]
        running = [one for one in known if one.start_ns <= t_ns < one.end_ns]
        if not running:
            return shown_episodes(ended, "idle", 0.0)
        return shown_episodes(ended, "recording", (t_ns - running[0].start_ns) / NS_PER_S)

    def _view(self, view: str, t_ns: int) -> ViewState:
        """The view as it was shown; a frame that is not whole does not count for its age."""
        captured_ns, shown = self._captured_ns[view], self._shown[view]
        until = int(np.searchsorted(shown.shown_ns, t_ns, side="right"))
        first = int(np.searchsorted(shown.shown_ns, t_ns - NS_PER_S, side="right"))
        counting = np.flatnonzero(shown.whole[:until])
        age_ns = t_ns - int(shown.capture_ns[counting[-1]]) if len(counting) else None
        latency_ns = int(shown.shown_ns[until - 1] - shown.capture_ns[until - 1]) if until else None
        given = np.searchsorted(captured_ns, (t_ns - NS_PER_S, t_ns))
        return ViewState(
            given_fps=float(given[1] - given[0]),
            age_ms=None if age_ns is None else age_ns / NS_PER_MS,
            shown_fps=float(until - first),
            latency_ms=None if latency_ns is None else latency_ns / NS_PER_MS,
        )


class _ShownFrames(NamedTuple):
    """A view's frames that were shown, in order of time."""

    shown_ns: Integers
    capture_ns: Integers
    whole: NDArray[np.bool_]

    @staticmethod
    def of(frames: Sequence[FrameShown], captured_ns: Mapping[int, int]) -> _ShownFrames:
        known = sorted(
            (one.shown_ns, captured_ns[one.index], one.whole is not False)
            for one in frames
            if one.index in captured_ns
        )
        shown_ns, capture_ns, whole = zip(*known, strict=True) if known else ((), (), ())
        return _ShownFrames(_times(shown_ns), _times(capture_ns), np.array(whole, dtype=np.bool_))


def _times(values: Sequence[int]) -> Integers:
    return np.array(values, dtype=np.int64)


def _last(records: Sequence[T], times_ns: Integers, t_ns: int) -> T | None:
    """The last record that is not later than `t_ns`."""
    number = int(np.searchsorted(times_ns, t_ns, side="right"))
    return records[number - 1] if number else None


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
