"""Where a replay is: laws of its position."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.console.replay.session import SPEEDS, Playback
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed

START_NS, END_NS = 7 * NS_PER_S, 27 * NS_PER_S


def played(speed: float = 1.0) -> Playback:
    return Playback(START_NS, END_NS, speed)


@pytest.mark.parametrize("speed", SPEEDS)
def test_it_goes_on_at_its_speed(speed: float) -> None:
    assert played(speed).step(NS_PER_S) == START_NS + round(speed * NS_PER_S)


def test_it_stays_at_the_end_and_goes_on_from_the_start() -> None:
    playback = played()
    assert playback.step(100 * NS_PER_S) == END_NS
    assert playback.at_end
    playback.toggle()
    assert playback.step(101 * NS_PER_S) == START_NS + NS_PER_S


def test_what_passes_before_it_begins_or_while_it_is_paused_is_not_made_up_for() -> None:
    playback = played()
    playback.begin(10 * NS_PER_S)
    assert playback.step(11 * NS_PER_S) == START_NS + NS_PER_S
    playback.toggle()
    assert playback.step(20 * NS_PER_S) == START_NS + NS_PER_S
    playback.toggle()
    assert playback.step(21 * NS_PER_S) == START_NS + 2 * NS_PER_S


def test_going_elsewhere_is_counted_and_going_on_is_not() -> None:
    playback = played()
    playback.step(30 * NS_PER_S)
    assert playback.jumps == 0
    playback.toggle()
    playback.move(NS_PER_S)
    playback.seek(END_NS)
    assert playback.jumps == 3


def test_speeds_go_up_and_down_within_their_ends() -> None:
    playback = played(3.0)
    playback.faster(1)
    assert playback.speed == 4.0
    playback.faster(99)
    assert playback.speed == SPEEDS[-1]
    playback.faster(-99)
    assert playback.speed == SPEEDS[0]


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("step"), st.integers(0, 10 * NS_PER_S)),
            st.tuples(st.just("move"), st.integers(-(1 << 62), 1 << 62)),
            st.tuples(st.just("seek"), st.integers(-(1 << 62), 1 << 62)),
            st.tuples(st.just("faster"), st.integers(-3, 3)),
            st.tuples(st.just("toggle"), st.just(0)),
        )
    )
)
def test_it_never_leaves_the_log(asked: list[tuple[str, int]]) -> None:
    playback, now_ns = played(), 0
    for what, amount in asked:
        if what == "step":
            now_ns += amount
            playback.step(now_ns)
        elif what == "toggle":
            playback.toggle()
        else:
            getattr(playback, what)(amount)
        assert START_NS <= playback.position_ns <= END_NS
