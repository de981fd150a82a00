"""A log shows, at any moment, what was shown when its records were new."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tams_app.config import load_config
from tams_app.console.replay.log_index import LogIndex
from tams_app.recording import SessionLog
from tams_app.recording.topics import TOPICS
from tams_app.records import (
    Allocation,
    CameraRates,
    LinkCapacity,
    Newest,
    Phase,
    PinnedView,
    Placed,
    Record,
    SessionState,
    StopRecord,
    ViewState,
)
from tams_app.robot.status import StatusBoard
from tams_app.teleop.hands import HAND_FACT
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.synthetic_session import START_NS, Synthetic

pytestmark = pytest.mark.untimed


def eventful() -> SessionLog:
    log = Synthetic(4.0, switch_s=2.0).log()
    log.pins = [PinnedView(START_NS + NS_PER_S, "gs"), PinnedView(START_NS + 3 * NS_PER_S, "")]
    log.placed = [Placed(START_NS + NS_PER_S, True), Placed(START_NS + 3 * NS_PER_S, False)]
    log.stops = [StopRecord("stale video", START_NS + 2 * NS_PER_S, None)]
    log.rates = [CameraRates(START_NS + s * NS_PER_S, {"gt": 30.0 - s}, {}) for s in range(4)]
    log.capacities = [LinkCapacity(START_NS + s * NS_PER_S, 6000.0 + s) for s in range(4)]
    return log


LOG, CONFIG = eventful(), load_config()
INDEX = LogIndex(LOG)
LISTS = (
    LOG.ticks,
    LOG.phases,
    LOG.pins,
    LOG.allocations,
    LOG.stops,
    LOG.rates,
    LOG.capacities,
    LOG.placed,
)
RECORDS: list[Record] = [record for records in LISTS for record in records]


class NoVideo:
    def age_ns(self, view: str, now_ns: int) -> None:
        return None

    def is_damaged(self, view: str) -> bool:
        return False


def of_the_records(state: SessionState) -> SessionState:
    """Without what is measured beside them, and the moment."""
    views = {
        name: ViewState(view.target_kbps, view.sent_kbps, view.given_fps)
        for name, view in state.views.items()
    }
    return replace(state, views=views, now_ns=0, heard_ns=None)


@given(st.integers(0, 4000))
def test_replay_and_a_running_session_make_the_same_state_of_the_same_records(at_ms: int) -> None:
    t_ns = START_NS + at_ms * NS_PER_MS
    newest = Newest()
    for record in RECORDS:
        if TOPICS[type(record)].time_ns(record) <= t_ns:
            newest.put(record)
    board = StatusBoard(CONFIG, newest)
    board.packets([one for one in LOG.packets if t_ns - NS_PER_S <= one.entered_ns < t_ns])
    board.receive(Allocation(t_ns, Phase.REACH, 0.0, 0.0, {}))
    live = board.state(t_ns, at_ms / 1000, NoVideo(), LOG.facts.get(HAND_FACT, ""))
    assert of_the_records(live) == of_the_records(INDEX.at(t_ns))
