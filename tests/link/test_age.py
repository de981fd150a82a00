"""Bounds on age, and on the clocks' offset, over any delays, losses, drift, steps and suspends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.age import LARGEST_DRIFT, ClockOffset, LeastOffset, PeerClock
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

DRIFT_PPM = round(LARGEST_DRIFT * 1e6 / 2)  # of each clock
WINDOW_NS = 10 * NS_PER_S
LONGEST_NS = 3 * NS_PER_S
DELAY_NS = st.integers(0, LONGEST_NS)
PERIOD_NS = 16 * NS_PER_MS
# What an exchange is widened by: its stamps are no older than both ways and what waits there.
SPREAD_NS = math.ceil((2 * LONGEST_NS + NS_PER_S) * LARGEST_DRIFT)


@dataclass(frozen=True)
class Watch:
    """A monotonic clock: what it shows at a true time. It may be stepped, or stand still."""

    start_ns: int
    drift_ppm: int = 0
    changed_ns: int = 0  # when it is stepped, or from when on it stands still
    step_ns: int = 0
    still_ns: int = 0  # for so long

    def shows_ns(self, t_ns: int) -> int:
        after_ns = t_ns - self.changed_ns
        runs_ns = t_ns - min(max(0, after_ns), self.still_ns)
        shown_ns = int(runs_ns * Fraction(1_000_000 + self.drift_ppm, 1_000_000))
        return self.start_ns + shown_ns + (self.step_ns if after_ns >= 0 else 0)

    def is_still(self, t_ns: int) -> bool:
        """Whether it stands still then, and with it its computer, which sends and takes nothing."""
        return self.still_ns > 0 and 0 <= t_ns - self.changed_ns <= self.still_ns

    def awake_ns(self, t_ns: int) -> int:
        """When what arrives then is taken in."""
        return self.changed_ns + self.still_ns + 1 if self.is_still(t_ns) else t_ns


DRIFT = st.integers(min_value=-DRIFT_PPM, max_value=DRIFT_PPM)
START_NS = st.integers(10**13, 10**15)
watches = st.builds(Watch, START_NS, DRIFT)
suspended = st.builds(Watch, START_NS, DRIFT, DELAY_NS, st.just(0), st.integers(0, 3600 * NS_PER_S))
stepped = st.builds(
    Watch, START_NS, DRIFT, DELAY_NS, st.integers(-(10**10), 10**10) | st.integers(0, 50 * 10**6)
)


@dataclass(frozen=True)
class Trip:
    """One message: when it was sent and received, in true time."""

    sent_ns: int
    heard_ns: int


def trips(delays_ns: list[int | None], period_ns: int, start_ns: int = 0) -> list[Trip]:
    """Messages at a steady rate in the order in which they are received; None: lost."""
    sent = [
        Trip(start_ns + number * period_ns, start_ns + number * period_ns + delay_ns)
        for number, delay_ns in enumerate(delays_ns)
        if delay_ns is not None
    ]
    return sorted(sent, key=lambda trip: trip.heard_ns)


delays = st.lists(st.none() | DELAY_NS | st.integers(0, 30 * NS_PER_MS), min_size=1, max_size=60)


@dataclass(frozen=True)
class Stamps:
    """Those of one message of the other side, as this side takes it in."""

    echo_ns: int
    echo_received_ns: int
    sent_ns: int
    received_ns: int


def stamps_of(hand: Trip, states: list[Trip], ours: Watch, theirs: Watch) -> Stamps:
    """With the newest of our stamps that had been received there; 0 before the first."""
    received = [state for state in states if state.heard_ns <= hand.sent_ns]
    newest = max(received, key=lambda state: state.sent_ns, default=None)
    return Stamps(
        0 if newest is None else ours.shows_ns(newest.sent_ns),
        0 if newest is None else theirs.shows_ns(newest.heard_ns),
        theirs.shows_ns(hand.sent_ns),
        ours.shows_ns(hand.heard_ns),
    )


def taken(clock: PeerClock, stamps: Stamps) -> int | None:
    """The age of a message at most, once its exchange is taken in."""
    clock.step(stamps.echo_ns, stamps.echo_received_ns, stamps.sent_ns, stamps.received_ns)
    return clock.age_ns(stamps.sent_ns, stamps.echo_ns, stamps.received_ns)


@given(
    ours=watches,
    theirs=watches | suspended,
    there=delays,
    back=delays,
    start=st.integers(0, NS_PER_S),
)
def test_no_message_is_older_than_its_bound(
    ours: Watch,
    theirs: Watch,
    there: list[int | None],
    back: list[int | None],
    start: int,
) -> None:
    """On our own clock, in any order, also where their computer is suspended."""
    clock = PeerClock()
    states = [Trip(one.sent_ns, theirs.awake_ns(one.heard_ns)) for one in trips(there, PERIOD_NS)]
    for hand in trips(back, PERIOD_NS // 2, start):
        if theirs.is_still(hand.sent_ns):
            continue
        stamps = stamps_of(hand, states, ours, theirs)
        bound_ns = taken(clock, stamps)
        if not stamps.echo_ns:
            assert bound_ns is None
        else:
            assert bound_ns is not None
            age_ns = stamps.received_ns - ours.shows_ns(hand.sent_ns)
            assert age_ns <= bound_ns <= stamps.received_ns - stamps.echo_ns


@given(ours=watches, theirs=stepped, there=delays, back=delays, start=st.integers(0, NS_PER_S))
def test_a_step_of_their_clock_shortens_no_bound_by_more_than_the_fastest_message_since(
    ours: Watch,
    theirs: Watch,
    there: list[int | None],
    back: list[int | None],
    start: int,
) -> None:
    """Steps are not for a monotonic clock; one that runs away is as one that is stepped."""
    states, clock = trips(there, PERIOD_NS), PeerClock()
    fastest_ns = 10**18
    for hand in trips(back, PERIOD_NS // 2, start):
        stamps = stamps_of(hand, states, ours, theirs)
        bound_ns = taken(clock, stamps)
        age_ns = stamps.received_ns - ours.shows_ns(hand.sent_ns)
        if bound_ns is None:
            continue
        if hand.sent_ns >= theirs.changed_ns:
            fastest_ns = min(fastest_ns, age_ns)
            assert bound_ns >= age_ns - fastest_ns - SPREAD_NS
        elif hand.heard_ns < theirs.changed_ns:
            assert bound_ns >= age_ns


@given(
    suspended_ns=st.integers(0, NS_PER_S),
    still_ns=st.integers(0, 3600 * NS_PER_S),
    drift_ppm=DRIFT,
    theirs=watches,
    there=delays,
    back=delays,
)
def test_after_our_computer_was_suspended_no_message_is_older_than_its_bound(
    suspended_ns: int,
    still_ns: int,
    drift_ppm: int,
    theirs: Watch,
    there: list[int | None],
    back: list[int | None],
) -> None:
    """Our clock has stood still: what was sent before is refused, not taken for newer."""
    ours = Watch(10**14, drift_ppm, suspended_ns, 0, still_ns)
    awake_ns = suspended_ns + still_ns
    states = [one for one in trips(there, PERIOD_NS) if not suspended_ns <= one.sent_ns < awake_ns]
    states += [Trip(one.sent_ns + awake_ns + 10, one.heard_ns + awake_ns + 10) for one in states]
    hands = trips(back, PERIOD_NS // 2) + trips(back, PERIOD_NS // 2, awake_ns)
    clock, slept = PeerClock(), False
    for hand in sorted(hands, key=lambda one: one.heard_ns):
        if suspended_ns <= hand.heard_ns < awake_ns:
            continue
        if hand.heard_ns >= awake_ns and not slept:
            slept = True
            clock.wake(ours.shows_ns(awake_ns) + 1)
        bound_ns = taken(clock, stamps_of(hand, states, ours, theirs))
        if bound_ns is not None:
            runs_ns = int((hand.heard_ns - hand.sent_ns) * Fraction(1_000_000 + drift_ppm, 10**6))
            assert bound_ns >= runs_ns - 1


@given(
    out_ns=st.integers(0, 400 * NS_PER_MS),
    back_ns=st.integers(0, 400 * NS_PER_MS),
    queued_ns=st.integers(0, LONGEST_NS),
    later_ns=st.integers(0, 60 * NS_PER_S),
)
def test_a_queue_on_our_way_out_makes_nothing_older(
    out_ns: int, back_ns: int, queued_ns: int, later_ns: int
) -> None:
    """But for the drift since an exchange without one."""
    clock, start_ns = PeerClock(), 10**10
    sent_ns = start_ns + out_ns
    clock.step(start_ns, sent_ns, sent_ns, sent_ns + back_ns)
    echo_ns = sent_ns + back_ns + later_ns
    sent_ns = echo_ns + out_ns + queued_ns
    stamps = Stamps(echo_ns, sent_ns, sent_ns, sent_ns + back_ns)
    bound_ns = taken(clock, stamps)
    assert bound_ns is not None
    drift_ns = 3 * (stamps.received_ns - start_ns) * LARGEST_DRIFT
    assert back_ns <= bound_ns <= back_ns + min(out_ns + drift_ns, out_ns + queued_ns) + 10


@given(st.integers(1, 10**15), DELAY_NS)
def test_before_the_first_exchange_the_bound_is_the_time_since_the_echo(
    echo_ns: int, elapsed_ns: int
) -> None:
    assert PeerClock().age_ns(12345, echo_ns, echo_ns + elapsed_ns) == elapsed_ns


@pytest.mark.parametrize("echo_ns", [0, -1, 1001, 10**18])
def test_an_echo_that_we_cannot_have_sent_bounds_nothing_and_is_no_exchange(echo_ns: int) -> None:
    clock = PeerClock()
    clock.step(echo_ns, 500, 600, 1000)
    assert clock.offset is None
    assert clock.age_ns(600, echo_ns, 1000) is None


@pytest.mark.parametrize(("echo_ns", "bounds"), [(4, False), (5, True), (6, True)])
def test_an_echo_from_before_our_computer_was_suspended_bounds_nothing(
    echo_ns: int, bounds: bool
) -> None:
    clock = PeerClock()
    clock.step(1, 1, 1, 1)
    clock.wake(5)
    assert clock.offset is None
    clock.step(echo_ns, 100, 100, 10)
    assert (clock.offset is not None) == bounds
    assert (clock.age_ns(100, echo_ns, 10) is not None) == bounds


def exchanged(*made: tuple[int, int, int, int]) -> ClockOffset | None:
    clock = PeerClock()
    for one in made:
        clock.step(*one)
    return clock.offset


def test_an_exchange_bounds_the_offset_by_both_of_its_ways() -> None:
    """Widened by the drift in the 2000 ns that it took."""
    assert exchanged((1000, 51_000, 52_000, 3000)) == ClockOffset(3000, 49_500, 501)
    clock = PeerClock()
    clock.step(1000, 51_000, 52_000, 3000)
    assert clock.round_trip_ns == 1002


def test_of_several_exchanges_each_way_counts_where_it_was_fastest() -> None:
    fast_out = (1000, 51_100, 51_100, 3000)  # offset 48_100 to 50_100
    fast_back = (3000, 54_900, 54_900, 5000)  # offset 49_900 to 51_900
    assert exchanged(fast_out, fast_back) == ClockOffset(5000, 50_000, 102)


def test_the_interval_widens_by_the_drift_from_exchange_to_exchange() -> None:
    clock = PeerClock()
    clock.step(1000, 51_000, 51_000, 1000)
    assert clock.round_trip_ns == 0
    later_ns = 1000 + 20_000_000
    clock.step(later_ns - 10**6, 50_000 + later_ns, 50_000 + later_ns, later_ns + 10**6)
    assert clock.round_trip_ns == 2 * 10_500
    assert clock.age_ns(50_000 + later_ns, later_ns - 10**6, later_ns + 10**6) == 10**6 + 10_500


def test_what_was_sent_before_the_newest_exchange_is_as_old_as_its_echo() -> None:
    """Their clock may have stood still between the two: it was suspended, say."""
    clock = PeerClock()
    clock.step(NS_PER_S, NS_PER_S, NS_PER_S, NS_PER_S)
    assert clock.age_ns(NS_PER_S - 1, NS_PER_S // 2, NS_PER_S) == NS_PER_S // 2
    assert clock.age_ns(NS_PER_S, NS_PER_S // 2, NS_PER_S) == 0
    clock.step(NS_PER_S // 2, NS_PER_S // 2, NS_PER_S, NS_PER_S)  # an older one changes nothing
    assert clock.age_ns(NS_PER_S - 1, NS_PER_S // 2, NS_PER_S) == NS_PER_S // 2
    clock.forget()
    clock.step(5, 5, 5, 5)
    assert clock.age_ns(5, 1, 5) == 0


@pytest.mark.parametrize(
    "contradiction",
    [(5000, 85_000, 85_000, 5000), (5000, 15_000, 15_000, 5000)],
    ids=["stepped forward", "stepped back"],
)
def test_an_exchange_that_contradicts_those_before_voids_them_and_what_had_been_sent_until_then(
    contradiction: tuple[int, int, int, int],
) -> None:
    before = (1000, 51_000, 51_000, 1000)
    assert exchanged(before, contradiction) is None
    begun_before = (5000, 55_000, 55_000, 6000)
    assert exchanged(before, contradiction, begun_before) is None
    begun_then = (5001, 85_001, 85_001, 5001)
    assert exchanged(before, contradiction, begun_then) == ClockOffset(5001, 80_000, 0)


def test_no_exchange_that_spans_a_step_counts_once_the_step_was_noticed() -> None:
    """Also where it does not contradict itself, since its own message was slow."""
    clock, step_ns = PeerClock(), 3_509_753
    sent_ns, ms = 10**9 + step_ns, NS_PER_MS
    clock.step(10**9, 10**9, sent_ns + 8 * ms, 10**9 + 8 * ms)
    late_ns = 10**9 + 16 * ms + 3_500_002
    clock.step(10**9, 10**9, sent_ns + 16 * ms, late_ns)
    assert clock.offset is None
    assert clock.age_ns(sent_ns + 16 * ms, 10**9, late_ns) == late_ns - 10**9


@pytest.mark.parametrize(
    "impossible",
    [(5000, 55_001, 55_000, 6000), (5000, 55_000, 57_000, 6000)],
    ids=["received after it sent", "less than no time on the way"],
)
def test_an_exchange_that_cannot_be_voids_all_and_the_echo_rules(
    impossible: tuple[int, int, int, int],
) -> None:
    clock = PeerClock()
    clock.step(1000, 51_000, 51_000, 1000)
    clock.step(*impossible)
    assert clock.offset is None
    assert clock.round_trip_ns is None
    assert clock.age_ns(55_000, 5000, 6000) == 1000


def test_an_exchange_whose_echo_was_not_received_there_tells_nothing() -> None:
    before = (1000, 51_000, 51_000, 1000)
    assert exchanged(before, (5000, 0, 55_000, 5000)) == exchanged(before)
    assert exchanged((5000, 1, 1, 5000)) == ClockOffset(5000, -4999, 0)


def test_a_message_that_is_yet_to_be_sent_by_its_clock_is_as_old_as_its_echo() -> None:
    clock = PeerClock()
    clock.step(1000, 51_000, 51_000, 1000)
    assert clock.age_ns(52_001, 1500, 2000) == 0  # the drift of 1000 ns is one
    assert clock.age_ns(52_002, 1500, 2000) == 500


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


@given(ours=watches, theirs=watches, there=delays, back=delays)
def test_the_offset_is_within_its_uncertainty_however_uneven_the_ways_are(
    ours: Watch, theirs: Watch, there: list[int | None], back: list[int | None]
) -> None:
    states, clock = trips(there, PERIOD_NS), PeerClock()
    for hand in trips(back, PERIOD_NS // 2):
        stamps = stamps_of(hand, states, ours, theirs)
        taken(clock, stamps)
        found = clock.offset
        if found is None or not stamps.echo_ns:
            continue
        assert found.t_ns == stamps.received_ns
        true_ns = theirs.shows_ns(hand.heard_ns) - stamps.received_ns
        assert abs(found.offset_ns - true_ns) <= found.uncertainty_ns + 2
        assert clock.round_trip_ns is not None
        assert found.uncertainty_ns == math.ceil(clock.round_trip_ns / 2)


# the most by which chrony turns a clock that is to catch up (maxslewrate)
@pytest.mark.parametrize("ppm", [5_000, 83_333, -83_333])
def test_of_a_slewed_clock_an_age_is_short_by_the_fastest_message_and_what_it_gained_since_at_most(
    ppm: int,
) -> None:
    """Two minutes; ways of 20 ms, and every ten seconds a queue of up to 480 ms on the way back."""
    ours, theirs = Watch(10**14), Watch(5 * 10**12, ppm)
    way_ns = 20 * NS_PER_MS
    clock, worst_ns, most_queued_ns = PeerClock(), 0, 0
    for number in range(120 * NS_PER_S // PERIOD_NS):
        sent_ns, queue_ns = NS_PER_S + number * PERIOD_NS, max(0, number % 625 - 594) * PERIOD_NS
        hand = Trip(sent_ns, sent_ns + way_ns + queue_ns)
        echo_ns = sent_ns - way_ns - PERIOD_NS // 2
        stamps = stamps_of(hand, [Trip(echo_ns, echo_ns + way_ns)], ours, theirs)
        bound_ns = taken(clock, stamps)
        assert bound_ns is not None
        worst_ns = max(worst_ns, hand.heard_ns - hand.sent_ns - bound_ns)
        most_queued_ns = max(most_queued_ns, queue_ns)
    gained_ns = max(0, ppm) * 2 * (way_ns + most_queued_ns) // 10**6
    assert worst_ns <= way_ns + gained_ns
