"""Bounds on age, and estimates of the clocks' offset, over any delays, losses and drift."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.age import ClockOffset, LeastOffset, OffsetEstimate, age_bound_ns
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

DRIFT_PPM = 100
WINDOW_NS = 10 * NS_PER_S
DELAY_NS = st.integers(0, 3 * NS_PER_S)
PERIOD_NS = 16 * NS_PER_MS


@dataclass(frozen=True)
class Watch:
    """A monotonic clock: what it shows at a true time."""

    start_ns: int
    drift_ppm: int

    def shows_ns(self, t_ns: int) -> int:
        return self.start_ns + int(t_ns * Fraction(1_000_000 + self.drift_ppm, 1_000_000))


watches = st.builds(
    Watch, st.integers(1, 10**15), st.integers(min_value=-DRIFT_PPM, max_value=DRIFT_PPM)
)


@dataclass(frozen=True)
class Trip:
    """One message: when it was sent and heard, in true time."""

    sent_ns: int
    heard_ns: int


def trips(delays_ns: list[int | None], period_ns: int, start_ns: int = 0) -> list[Trip]:
    """Messages at a steady rate in the order in which they are heard; None: lost."""
    sent = [
        Trip(start_ns + number * period_ns, start_ns + number * period_ns + delay_ns)
        for number, delay_ns in enumerate(delays_ns)
        if delay_ns is not None
    ]
    return sorted(sent, key=lambda trip: trip.heard_ns)


delays = st.lists(st.none() | DELAY_NS | st.integers(0, 30 * NS_PER_MS), min_size=1, max_size=30)


@given(ours=watches, theirs=watches, there=delays, back=delays, start=st.integers(0, NS_PER_S))
def test_no_message_is_older_than_its_bound(
    ours: Watch,
    theirs: Watch,
    there: list[int | None],
    back: list[int | None],
    start: int,
) -> None:
    """On our own clock; the other side's, whatever it shows, has no part in it."""
    states = trips(there, PERIOD_NS)
    for hand in trips(back, PERIOD_NS // 2, start):
        echoes = [s.sent_ns for s in states if s.heard_ns <= hand.sent_ns]
        echo_ns = ours.shows_ns(max(echoes)) if echoes else 0
        heard_ns = ours.shows_ns(hand.heard_ns)
        bound_ns = age_bound_ns(heard_ns, echo_ns)
        if not echoes:
            assert bound_ns is None
        else:
            assert bound_ns is not None
            assert bound_ns >= heard_ns - ours.shows_ns(hand.sent_ns)


@given(st.integers(1, 10**15), DELAY_NS)
def test_the_bound_is_the_round_trip_and_what_waited_at_the_other_side(
    echo_ns: int, elapsed_ns: int
) -> None:
    assert age_bound_ns(echo_ns + elapsed_ns, echo_ns) == elapsed_ns


@pytest.mark.parametrize("echo_ns", [0, -1, 1001, 10**18])
def test_an_echo_that_we_cannot_have_sent_bounds_nothing(echo_ns: int) -> None:
    assert age_bound_ns(1000, echo_ns) is None


@given(st.integers(1, 10), st.integers(0, 10))
def test_an_echo_from_before_our_computer_was_suspended_bounds_nothing(
    echo_ns: int, awake_ns: int
) -> None:
    expected_ns = None if echo_ns < awake_ns else 10 - echo_ns
    assert age_bound_ns(10, echo_ns, awake_ns) == expected_ns


@given(
    st.lists(
        st.tuples(st.integers(0, 3 * NS_PER_S), st.integers(-(10**12), 10**12)),
        min_size=1,
        max_size=60,
    )
)
def test_the_least_offset_is_that_of_the_last_ten_seconds(steps: list[tuple[int, int]]) -> None:
    least, now_ns = LeastOffset(10 * NS_PER_S), 0
    seen: list[tuple[int, int]] = []
    for elapsed_ns, difference_ns in steps:
        now_ns += elapsed_ns
        seen.append((now_ns, difference_ns))
        recent = [d for t, d in seen if now_ns - t <= WINDOW_NS]
        assert least.step(now_ns, difference_ns) == min(recent)


def test_a_least_offset_counts_until_its_window_is_over() -> None:
    least = LeastOffset(window_ns=100)
    told = [least.step(0, 1), least.step(100, 5), least.step(101, 7), least.step(200, 8)]
    assert told == [1, 1, 5, 5]


@given(
    ours=watches,
    theirs=watches,
    delays_ns=st.lists(DELAY_NS, min_size=1, max_size=50),
)
def test_by_the_least_offset_nothing_seems_newer_than_it_can_be(
    ours: Watch, theirs: Watch, delays_ns: list[int]
) -> None:
    """What is sent later than the best message seems later, but for drift within the window."""
    least = LeastOffset(10 * NS_PER_S)
    for trip in trips(list(delays_ns), PERIOD_NS):
        heard_ns, sent_ns = ours.shows_ns(trip.heard_ns), theirs.shows_ns(trip.sent_ns)
        ours_ns = sent_ns + least.step(heard_ns, heard_ns - sent_ns)
        assert ours_ns <= heard_ns
        drifted_ns = 2 * DRIFT_PPM * (WINDOW_NS + max(delays_ns)) // 1_000_000
        assert ours_ns >= ours.shows_ns(trip.sent_ns) + min(delays_ns) - drifted_ns - 10


@st.composite
def exchanges(draw: st.DrawFn) -> list[tuple[int, int, int, int]]:
    """True times: sent here, heard there, sent back there, heard here."""
    t_ns, made = 0, []
    for _ in range(draw(st.integers(1, 40))):
        t_ns += draw(st.integers(0, 2 * NS_PER_S))
        there_ns = t_ns + draw(DELAY_NS)
        back_ns = there_ns + draw(st.integers(0, 100 * NS_PER_MS))
        made.append((t_ns, there_ns, back_ns, back_ns + draw(DELAY_NS)))
    return sorted(made, key=lambda times: times[3])


@given(exchanges(), st.integers(-(10**9), 10**15))
def test_the_offset_is_within_its_uncertainty_however_uneven_the_ways_are(
    made: list[tuple[int, int, int, int]], offset_ns: int
) -> None:
    estimate = OffsetEstimate()
    start_ns = 10**10
    for sent_ns, there_ns, back_ns, heard_ns in made:
        now = estimate.step(
            start_ns + sent_ns,
            start_ns + offset_ns + there_ns,
            start_ns + offset_ns + back_ns,
            start_ns + heard_ns,
        )
        assert now is not None
        assert abs(now.offset_ns - offset_ns) <= now.uncertainty_ns + 1
        assert start_ns + heard_ns - now.t_ns <= WINDOW_NS


@given(exchanges(), watches, watches)
def test_drift_adds_no_more_than_the_clocks_drift_apart_in_the_window(
    made: list[tuple[int, int, int, int]], ours: Watch, theirs: Watch
) -> None:
    estimate = OffsetEstimate()
    for sent_ns, there_ns, back_ns, heard_ns in made:
        now = estimate.step(
            ours.shows_ns(sent_ns),
            theirs.shows_ns(there_ns),
            theirs.shows_ns(back_ns),
            ours.shows_ns(heard_ns),
        )
        if now is None:  # by their clocks the round trip took less than no time
            continue
        offset_ns = theirs.shows_ns(heard_ns) - ours.shows_ns(heard_ns)
        longest_ns = WINDOW_NS + max(times[3] - times[0] for times in made)
        drifted_ns = 2 * DRIFT_PPM * longest_ns // 1_000_000
        assert abs(now.offset_ns - offset_ns) <= now.uncertainty_ns + drifted_ns + 10


def test_the_exchange_with_the_shortest_round_trip_counts_for_ten_seconds() -> None:
    estimate = OffsetEstimate()
    start_ns = NS_PER_S

    def exchange(t_ns: int, round_trip_ns: int) -> int:
        sent_ns = start_ns + t_ns
        there_ns = sent_ns + round_trip_ns  # all of it on the way there
        now = estimate.step(sent_ns, there_ns, there_ns, sent_ns + round_trip_ns)
        assert now is not None
        return now.uncertainty_ns

    assert exchange(0, 40 * NS_PER_MS) == 20 * NS_PER_MS
    assert exchange(NS_PER_S, 10 * NS_PER_MS) == 5 * NS_PER_MS
    assert exchange(10 * NS_PER_S, 90 * NS_PER_MS) == 5 * NS_PER_MS
    assert exchange(12 * NS_PER_S, 60 * NS_PER_MS) == 30 * NS_PER_MS


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0, 1, NS_PER_S, 5 * NS_PER_S, WINDOW_NS, WINDOW_NS + 1]),
            st.integers(0, 3),
        ),
        min_size=1,
        max_size=20,
    )
)
def test_of_equally_short_round_trips_within_ten_seconds_the_newest_counts(
    made: list[tuple[int, int]],
) -> None:
    """The clocks have drifted least since then."""
    estimate, heard_ns = OffsetEstimate(), NS_PER_S
    seen: list[tuple[int, int]] = []
    for elapsed_ns, round_trip_ns in made:
        heard_ns += elapsed_ns
        seen.append((round_trip_ns, heard_ns))
        sent_ns = heard_ns - round_trip_ns
        now = estimate.step(sent_ns, sent_ns, sent_ns, heard_ns)
        recent = [(trip, -t) for trip, t in seen if heard_ns - t <= WINDOW_NS]
        assert now is not None
        assert now.t_ns == -min(recent)[1]
        assert now.uncertainty_ns == math.ceil(min(recent)[0] / 2)


@pytest.mark.parametrize(
    ("sent_ns", "there_ns", "back_ns", "heard_ns"),
    [(0, 5, 6, 10), (5, 0, 1, 10), (5, 5, 20, 10)],
    ids=["not sent", "not heard there", "back before it was there"],
)
def test_an_exchange_that_cannot_be_tells_nothing(
    sent_ns: int, there_ns: int, back_ns: int, heard_ns: int
) -> None:
    estimate = OffsetEstimate()
    assert estimate.now is None
    assert estimate.step(sent_ns, there_ns, back_ns, heard_ns) is None


def test_every_stamp_above_zero_is_one() -> None:
    """Zero stands for never."""
    assert OffsetEstimate().step(1, 1, 1, 1) == ClockOffset(1, 0, 0)
