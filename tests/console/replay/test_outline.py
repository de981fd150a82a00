"""The bar over a whole log: phases and states in order, no stop lost, never too long to be told."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import msgspec
import pytest

from tams_app.console.replay.log_index import CELLS, outline_of, phases_row
from tams_app.faces.facts_memory import FactsWriter
from tams_app.faces.messages import LONGEST, Notice, ReplayFacts, Stretch
from tams_app.recording import SessionLog, read_log
from tams_app.records import Phase, PhaseChange
from tams_app.units import NS_PER_S
from tests.faces.window.facts import FACTS, OPENING, changed
from tests.golden_logs import golden_log
from tests.synthetic_session import START_NS, header, tick

pytestmark = pytest.mark.untimed


def log_of(seconds: int, armings: list[str], phases: tuple[Phase, ...] = ()) -> SessionLog:
    """Ticks and phases at even distances."""

    def at(number: int, of: int) -> int:
        return START_NS + number * seconds * NS_PER_S // of

    log = SessionLog(header(), START_NS + seconds * NS_PER_S)
    log.ticks += [
        replace(tick(0), arming=arming, started_ns=at(number, len(armings)))
        for number, arming in enumerate(armings)
    ]
    log.phases += [
        PhaseChange(at(number, len(phases)), phase, "a rule") for number, phase in enumerate(phases)
    ]
    return log


def test_phases_and_states_follow_each_other_to_the_end_as_in_the_log() -> None:
    log = read_log(golden_log("outage"))
    outline = outline_of(log)
    assert outline.end_s == pytest.approx(14.0, abs=0.01)
    assert [one.what for one in outline.phases] == [change.phase.value for change in log.phases]
    cell_s = outline.end_s / CELLS
    for stretch, change in zip(outline.phases, log.phases, strict=True):
        changed_s = (change.t_ns - log.header.started_ns) / NS_PER_S
        assert 0 <= changed_s - stretch.begin_s <= cell_s
    for stretches in (outline.phases, outline.states):
        assert stretches[-1].end_s == pytest.approx(outline.end_s)
        assert all(one.end_s == other.begin_s for one, other in pairwise(stretches))
    assert outline.states[-1].what == "holding"


def test_a_stop_is_seen_however_short_it_was_and_the_worst_of_several() -> None:
    armings = ["engaged"] * 20_000
    armings[10_000:10_002] = ["holding", "fault"]
    states = outline_of(log_of(3600, armings)).states
    assert [one.what for one in states] == ["engaged", "fault", "engaged"]
    assert states[1].begin_s == pytest.approx(1800.0)


def test_where_nothing_was_recorded_nothing_is_shown() -> None:
    assert outline_of(SessionLog(header(), START_NS)).states == ()
    log = log_of(10, [])
    log.phases.append(PhaseChange(START_NS + 5 * NS_PER_S, Phase.ALIGN, "a rule"))
    assert outline_of(log).phases == (Stretch(5.0, 10.0, "ALIGN"),)


def test_the_outline_of_the_longest_log_can_be_told_to_the_window() -> None:
    pairs = CELLS // 2
    phases = (Phase.PRE_RELEASE, Phase.TRANSPORT) * pairs
    outline = outline_of(log_of(36_000, ["holding", "engaged"] * pairs, phases))
    assert len(outline.phases) == len(outline.states) == CELLS
    opening = msgspec.structs.replace(OPENING, replay=outline)
    assert len(msgspec.msgpack.encode(opening)) < LONGEST


def test_marks_in_every_cell_can_be_told_to_the_window() -> None:
    log = log_of(36_000, [])
    names = (Phase.PRE_RELEASE.value, Phase.TRANSPORT.value)
    row = phases_row(log, [(cell * 60 * NS_PER_S, names[cell % 2]) for cell in range(CELLS)])
    assert len(row) == CELLS
    replay = ReplayFacts(16.0, True, 10_000, row)
    notices = (Notice(36_000.0, "x" * 500),) * 3
    facts = FactsWriter()
    facts.put(changed(FACTS, replay=replay, notices=notices))
    facts.close()
