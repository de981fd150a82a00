"""What goes to an operator over the link, and how often."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tams_app.config import load_config
from tams_app.link.channel import STATE_BYTES
from tams_app.link.gateway_client import LinkEvent
from tams_app.link.messages import SessionDescription, StateMessage, decode
from tams_app.records import Allocation, Phase, SessionState
from tams_app.robot import linked_operator
from tams_app.robot.control import Signals
from tams_app.robot.ground import Ground
from tams_app.robot.linked_operator import LinkedOperator, fitting, welcome_of
from tams_app.robot.linked_state import LinkedState, state_interval_ns
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.mailbox import Sentences
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import RepairRule
from tests.faces.window.facts import STATE
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.untimed

TICK_NS = NS_PER_S // 120


@pytest.mark.parametrize(
    ("capacity_kbps", "states"), [(None, 60), (20_000.0, 60), (1000.0, 20), (100.0, 10)]
)
def test_states_are_rarer_on_a_narrow_uplink(capacity_kbps: float | None, states: int) -> None:
    """In a second of ticks; None: before the first allocation."""
    clock, sent = VirtualClock(NS_PER_S), []
    log = MemoryJournal(VirtualClock())
    gateway: Any = SimpleNamespace(send=sent.append, event=LinkEvent())
    operator = LinkedOperator(
        Ground(load_config(), clock, log, Signals()), gateway, {}, Sentences()
    )
    if capacity_kbps is not None:
        operator.receive(Allocation(0, Phase.REACH, capacity_kbps, 0.0, {}))
    for _ in range(120):
        clock.advance_ns(TICK_NS)
        now_ns = clock.now_ns()
        if operator.wants_state(now_ns):
            made_ns = now_ns + 2 * NS_PER_MS  # what a tick takes until then
            operator.show(msgspec.structs.replace(STATE, now_ns=made_ns))
    assert len(sent) == pytest.approx(states, abs=1)


@pytest.mark.parametrize("fits", [True, False])
def test_what_is_too_much_to_be_told_of_driving_is_left_out_with_a_word(
    monkeypatch: pytest.MonkeyPatch, fits: bool
) -> None:
    if not fits:
        monkeypatch.setattr(linked_operator, "WELCOME_BYTES", 300)
    config = load_config(None, {"limits.max_speed_mm_s": 150.0})
    log = MemoryJournal(VirtualClock())
    video: Any = SimpleNamespace(rule=RepairRule(True, 60, 300.0), feedback=True)
    content = fitting(welcome_of(config, video, "robot"), log)
    driving = decode(content, SessionDescription).driving
    assert driving == ({"limits": {"max_speed_mm_s": 150.0}} if fits else None)
    assert ("as received" in " ".join(log.notes)) is not fits


JOINTS = (1_234_567, -2_345_678, 123_456, -3_456_789, 234_567, -34_567)
LATE_NS = 10**15  # a computer that has run for eleven days


def content(state: SessionState, note: str = "") -> bytes:
    linked = LinkedState(VirtualClock(LATE_NS))
    if note:
        linked.note(note)
    return linked.datagram(state, None, LATE_NS, (3, 1), (LATE_NS,) * 3)


def state_with(reason: str) -> SessionState:
    return msgspec.structs.replace(
        STATE,
        reason=reason,
        last_stop="hand not followed",
        now_ns=LATE_NS,
        heard_ns=LATE_NS,
        joints_urad=JOINTS,
        joints_ns=LATE_NS - NS_PER_S // 100,
        speed_scale=0.87654321,
    )


def test_the_arms_joints_are_told() -> None:
    told = decode(content(state_with("stale video")), StateMessage).state
    assert told.joints_urad == JOINTS
    assert told.joints_ns == LATE_NS - NS_PER_S // 100
    assert told.speed_scale == 0.87654321


def test_a_state_with_its_longest_reason_is_no_longer_than_the_others() -> None:
    """By its length an attacker would learn what the arm does, and a narrow link would fill."""
    for length in range(0, 230, 5):
        assert len(content(state_with("x" * length))) <= STATE_BYTES


def test_a_sentence_for_the_operator_is_told_with_a_long_reason() -> None:
    told = decode(content(state_with("x" * 220), note="take care"), StateMessage)
    assert told.state.reason == "x" * 220


@pytest.mark.parametrize(
    ("capacity_kbps", "rate_hz"),
    [(60.0, 10.0), (350.0, 10.0), (1000.0, 21.7), (2700.0, 58.5), (3000.0, 60.0), (1e9, 60.0)],
)
def test_states_take_a_tenth_of_the_uplink_ten_to_sixty_times_a_second(
    capacity_kbps: float, rate_hz: float
) -> None:
    """At 60 they would take 277 kbit/s, of a link of 350."""
    interval_ns = state_interval_ns(capacity_kbps) + NS_PER_S // 1000
    assert NS_PER_S / interval_ns == pytest.approx(rate_hz, rel=0.01)


def test_an_uplink_without_limit_is_told_of_as_often_as_any() -> None:
    assert state_interval_ns(float("inf")) == state_interval_ns(1e9)
