"""The state that goes to an operator over the link."""

from __future__ import annotations

import msgspec
import pytest

from tams_app.link.messages import StateMessage, decode
from tams_app.link.sealing import STATE_BYTES
from tams_app.records import SessionState
from tams_app.robot.linked_state import LinkedState, state_interval_ns
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_S
from tests.faces.window.facts import STATE

pytestmark = pytest.mark.untimed

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
        assert len(content(state_with("x" * length))) < STATE_BYTES


def test_a_sentence_for_the_operator_is_told_with_a_long_reason() -> None:
    told = decode(content(state_with("x" * 220), note="take care"), StateMessage)
    assert told.state.reason == "x" * 220


@pytest.mark.parametrize(
    ("capacity_kbps", "rate_hz"),
    [(60.0, 10.0), (350.0, 10.0), (1000.0, 22.0), (2700.0, 59.3), (3000.0, 60.0), (1e9, 60.0)],
)
def test_states_take_a_tenth_of_the_uplink_ten_to_sixty_times_a_second(
    capacity_kbps: float, rate_hz: float
) -> None:
    """At 60 they would take 273 kbit/s, of a link of 350."""
    interval_ns = state_interval_ns(capacity_kbps) + NS_PER_S // 1000
    assert NS_PER_S / interval_ns == pytest.approx(rate_hz, rel=0.01)


def test_an_uplink_without_limit_is_told_of_as_often_as_any() -> None:
    assert state_interval_ns(float("inf")) == state_interval_ns(1e9)
