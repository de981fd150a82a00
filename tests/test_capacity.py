"""What a bottleneck carries over time."""

import math
from itertools import accumulate

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tams_app.capacity import ConstantCapacity, RateTrace, TraceCapacity, UnlimitedCapacity
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

EPOCH_NS = 7 * NS_PER_S


@st.composite
def traces(draw):
    steps = draw(
        st.lists(
            st.tuples(st.integers(1, 500), st.sampled_from([0, 1, 300, 6000, 20_000])),
            min_size=1,
            max_size=8,
        ).filter(lambda steps: any(rate for _, rate in steps))
    )
    starts, t = [], 0
    for length_ms, _ in steps:
        starts.append(t * NS_PER_MS)
        t += length_ms
    return RateTrace(tuple(starts), tuple(float(rate) for _, rate in steps), t * NS_PER_MS)


capacities = st.one_of(
    st.integers(1, 50_000).map(lambda kbps: ConstantCapacity(float(kbps))),
    traces().map(lambda trace: TraceCapacity(trace, EPOCH_NS)),
)
times = st.integers(EPOCH_NS, EPOCH_NS + 5 * NS_PER_S)


def bits_between(capacity, start_ns, end_ns):
    """What fits through from one instant to a later one [bit]."""
    return capacity.mean_kbps(start_ns, end_ns) * 1e-6 * (end_ns - start_ns)


def bits_of_a_round(trace):
    """What a trace carries until it repeats [bit]."""
    ends_ns = (*trace.starts_ns[1:], trace.period_ns)
    steps = zip(trace.starts_ns, ends_ns, trace.kbps, strict=True)
    return list(accumulate((end - start) * (kbps * 1e-6) for start, end, kbps in steps))[-1]


@given(capacities, times, st.integers(1, 12_000))
def test_a_packet_ends_at_the_first_instant_its_bits_have_passed(capacity, start_ns, bits):
    end_ns = capacity.finish_ns(start_ns, bits)
    assert end_ns > start_ns
    assert bits_between(capacity, start_ns, end_ns) >= bits - 1e-3
    assert bits_between(capacity, start_ns, end_ns - 2) < bits + 1e-3


@given(capacities, times, times, times)
def test_what_passes_in_two_windows_adds_up(capacity, a_ns, b_ns, c_ns):
    a_ns, b_ns, c_ns = sorted((a_ns, b_ns, c_ns))
    whole = bits_between(capacity, a_ns, c_ns)
    parts = bits_between(capacity, a_ns, b_ns) + bits_between(capacity, b_ns, c_ns)
    assert whole == pytest.approx(parts, abs=1e-3)


LATE_START = RateTrace((0, 720_574_199), (0.0, 18_095.845729028122), 890_768_189)


@given(traces(), st.integers(1, 10**6))
@example(LATE_START, 25_224)
@example(RateTrace((0, 3), (7.0, 0.0), 9), 27)
def test_what_whole_rounds_carry_has_passed_when_the_last_of_them_stops_sending(trace, rounds):
    capacity = TraceCapacity(trace, 0)
    ends_ns = (*trace.starts_ns[1:], trace.period_ns)
    stops_ns = max(end for end, rate in zip(ends_ns, trace.kbps, strict=True) if rate)
    bits = rounds * bits_of_a_round(trace)
    end_ns = capacity.finish_ns(0, bits)
    assert abs(end_ns - (rounds - 1) * trace.period_ns - stops_ns) <= 1


def test_bits_rounded_to_the_end_of_a_round_do_not_fall_into_an_outage():
    capacity = TraceCapacity(LATE_START, 0)
    bits = 77_684_980_814.09258
    rounds = round(bits / bits_of_a_round(LATE_START))
    assert abs(capacity.finish_ns(0, bits) - rounds * LATE_START.period_ns) <= 1


@given(traces(), st.integers(0, 3 * NS_PER_S), st.integers(1, 4))
def test_a_trace_repeats(trace, t_ns, rounds):
    capacity = TraceCapacity(trace, EPOCH_NS)
    later_ns = t_ns + rounds * trace.period_ns
    assert capacity.rate_kbps(EPOCH_NS + t_ns) == capacity.rate_kbps(EPOCH_NS + later_ns)


def test_the_mean_of_a_trace_weighs_each_rate_by_its_time():
    trace = RateTrace((0, 100 * NS_PER_MS), (6000.0, 2000.0), 200 * NS_PER_MS)
    capacity = TraceCapacity(trace, EPOCH_NS)
    at = lambda ms: EPOCH_NS + ms * NS_PER_MS  # noqa: E731
    assert capacity.mean_kbps(at(75), at(175)) == pytest.approx(3000.0)
    assert capacity.mean_kbps(at(150), at(250)) == pytest.approx(4000.0)
    assert capacity.mean_kbps(at(120), at(120)) == 2000.0


def test_a_window_before_the_epoch_knows_nothing_of_the_end_of_the_trace():
    trace = RateTrace((0, 100 * NS_PER_MS), (6000.0, 2000.0), 200 * NS_PER_MS)
    capacity = TraceCapacity(trace, EPOCH_NS)
    assert capacity.mean_kbps(EPOCH_NS - 100 * NS_PER_MS, EPOCH_NS) == pytest.approx(6000.0)


def test_without_a_bottleneck_nothing_waits():
    capacity = UnlimitedCapacity()
    assert capacity.finish_ns(42, 10**9) == 42
    assert capacity.mean_kbps(0, 1) == math.inf


@pytest.mark.parametrize(
    ("starts_ns", "kbps", "period_ns", "reason"),
    [
        ((), (), 1, "one at least"),
        ((0, 5), (1.0,), 9, "as many rates"),
        ((1,), (1.0,), 9, "ascend from 0"),
        ((0, 5), (1.0, 1.0), 5, "ascend from 0"),
        ((0,), (-1.0,), 5, "not negative"),
        ((0,), (math.inf,), 5, "finite"),
        ((0, 3), (0.0, 0.0), 5, "carries nothing"),
    ],
)
def test_a_senseless_trace_is_refused(starts_ns, kbps, period_ns, reason):
    with pytest.raises(ValueError, match=reason):
        RateTrace(starts_ns, kbps, period_ns)


@pytest.mark.parametrize("kbps", [0.0, -1.0, 5e-324, 1e-300, 0.99, math.inf, math.nan])
def test_a_senseless_rate_is_refused(kbps):
    with pytest.raises(ValueError, match="finite and at least 1 kbit/s"):
        ConstantCapacity(kbps)
