"""The emulated uplink: laws of its queue, its delay and its losses."""

from itertools import groupby, pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.capacity import ConstantCapacity, RateTrace, TraceCapacity, UnlimitedCapacity
from tams_app.config import Network
from tams_app.records import PacketFate, PacketKind
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import GilbertElliottLoss, Link, loss_model

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
START_NS = 3 * NS_PER_S

networks = st.builds(
    Network,
    latency_ms=st.sampled_from([0, 15, 40]),
    jitter_ms=st.sampled_from([0, 8]),
    loss=st.sampled_from([0, 0.1]),
    loss_burst=st.sampled_from([1.0, 3.0]),
    queue_min_bytes=st.sampled_from([1500, 30_000]),
)
capacities = st.sampled_from(
    [
        ConstantCapacity(3000.0),
        ConstantCapacity(40_000.0),
        UnlimitedCapacity(),
        TraceCapacity(
            RateTrace(
                tuple(ms * NS_PER_MS for ms in (0, 20, 60)), (9000.0, 0.0, 2500.0), 90 * NS_PER_MS
            ),
            START_NS,
        ),
    ]
)
offers = st.lists(
    st.tuples(
        st.integers(0, 15 * NS_PER_MS),
        st.sampled_from(VIEWS),
        st.sampled_from(list(PacketKind)),
        st.integers(40, 1500),
    ),
    max_size=60,
)


def send(link, packets):
    now_ns, records = START_NS, []
    for n, (gap_ns, view, kind, size_bytes) in enumerate(packets):
        now_ns += gap_ns
        records.append(link.offer(now_ns, view, kind, size_bytes, n))
    return records


def departed(records):
    return [record for record in records if record.fate is not PacketFate.OVERFLOW]


def delivered(records):
    return [record for record in records if record.fate is PacketFate.DELIVERED]


def steady(count, view="eih", gap_ns=2 * NS_PER_MS, size_bytes=1000):
    return [(gap_ns, view, PacketKind.MEDIA, size_bytes)] * count


@given(networks, capacities, offers)
def test_packets_leave_and_arrive_in_the_order_they_came(network, capacity, packets):
    records = send(Link(network, capacity, VIEWS, 1), packets)
    assert [(one.view, one.kind, one.size_bytes) for one in records] == [one[1:] for one in packets]
    assert [one.sequence for one in records] == list(range(len(packets)))
    for first, second in pairwise(departed(records)):
        assert first.departed_ns <= second.departed_ns
    for first, second in pairwise(delivered(records)):
        assert first.delivered_ns <= second.delivered_ns


@given(networks, capacities, offers)
def test_no_more_leaves_the_bottleneck_than_it_carries(network, capacity, packets):
    through = departed(send(Link(network, capacity, VIEWS, 1), packets))
    bits = [8 * record.size_bytes for record in through]
    for i, first in enumerate(through):
        for j in range(i + 1, len(through)):
            start_ns, end_ns = first.departed_ns, through[j].departed_ns
            if not isinstance(capacity, UnlimitedCapacity):
                carried = capacity.mean_kbps(start_ns, end_ns) * 1e-6 * (end_ns - start_ns)
                assert sum(bits[i + 1 : j + 1]) <= carried + 1e-3


@given(networks, capacities, offers)
def test_the_queue_keeps_its_cap_and_drops_only_what_would_break_it(network, capacity, packets):
    records = send(Link(network, capacity, VIEWS, 1), packets)
    for n, record in enumerate(records):
        now_ns = record.entered_ns
        waiting = sum(earlier.size_bytes for earlier in records[:n] if earlier.departed_ns > now_ns)
        room = max(capacity.rate_kbps(now_ns) * network.queue_ms / 8, network.queue_min_bytes)
        fits = waiting + record.size_bytes <= room
        assert fits == (record.fate is not PacketFate.OVERFLOW)


@given(networks, offers)
def test_the_way_takes_at_least_latency_less_jitter_and_at_most_latency_and_jitter(
    network, packets
):
    link = Link(network, ConstantCapacity(5000.0), VIEWS, 1)
    every = send(link, packets)
    records = delivered(every)
    least_ns = max(0, network.latency_ms - network.jitter_ms) * NS_PER_MS
    most_ns = (network.latency_ms + network.jitter_ms) * NS_PER_MS
    assert all((r.delivered_ns > 0) == (r.fate is PacketFate.DELIVERED) for r in every)
    for record in records:
        assert record.entered_ns < record.departed_ns
        assert least_ns <= record.delivered_ns - record.departed_ns <= most_ns


@given(networks, capacities, offers)
def test_the_same_seed_gives_the_same_records(network, capacity, packets):
    assert send(Link(network, capacity, VIEWS, 9), packets) == send(
        Link(network, capacity, VIEWS, 9), packets
    )


@settings(max_examples=50)
@given(offers, st.sampled_from([1.0, 4.0]))
def test_the_nth_packet_of_a_view_meets_the_same_fate_whatever_else_is_sent(packets, burst):
    network = Network(loss=0.3, loss_burst=burst)
    alone = [packet for packet in packets if packet[1] == "gt" and packet[2] is PacketKind.MEDIA]
    alone_records = send(Link(network, UnlimitedCapacity(), VIEWS, 4), alone)
    together = send(
        Link(network, UnlimitedCapacity(), VIEWS, 4),
        [
            packet
            for packet in packets
            if packet[1] != "gt" or packet[2] in (PacketKind.MEDIA, PacketKind.RTCP)
        ],
    )
    of_view = [r for r in together if r.view == "gt" and r.kind is PacketKind.MEDIA]
    assert [record.fate for record in of_view] == [record.fate for record in alone_records]


def test_an_overflow_does_not_shift_the_fate_of_the_packets_behind_it():
    lossy = {"loss": 0.3, "queue_ms": 20, "queue_min_bytes": 1500}
    free = send(Link(Network(**lossy), UnlimitedCapacity(), VIEWS, 4), steady(300))
    tight = send(Link(Network(**lossy), ConstantCapacity(2000.0), VIEWS, 4), steady(300))
    pairs = [pair for pair in zip(free, tight, strict=True) if pair[1].departed_ns]
    assert 50 < len(pairs) < 250
    assert all(first.fate is second.fate for first, second in pairs)


def test_views_and_seeds_lose_different_packets():
    def fates(view, seed):
        link = Link(Network(loss=0.3), UnlimitedCapacity(), VIEWS, seed)
        return [record.fate for record in send(link, steady(200, view))]

    assert fates("eih", 1) != fates("gt", 1)
    assert fates("eih", 1) != fates("eih", 2)


def test_a_lone_packets_jitter_is_spread_evenly_over_its_range():
    link = Link(Network(latency_ms=40, jitter_ms=8), UnlimitedCapacity(), VIEWS, 5)
    records = send(link, steady(4000, gap_ns=20 * NS_PER_MS))
    delays_ms = sorted((r.delivered_ns - r.departed_ns) / NS_PER_MS for r in records)
    for quarter in (1, 2, 3):
        assert delays_ms[1000 * quarter] == pytest.approx(32 + 4 * quarter, abs=0.6)


def test_feedback_returns_after_the_delay_without_loss_or_queue():
    network = Network(latency_ms=40, jitter_ms=8, loss=1.0)
    link = Link(network, ConstantCapacity(1.0), VIEWS, 1)
    send(link, steady(20))
    arrivals = [link.feedback(START_NS + n * NS_PER_S, "eih") for n in range(200)]
    delays_ms = [(t - START_NS) / NS_PER_MS - 1000 * n for n, t in enumerate(arrivals)]
    assert 32 <= min(delays_ms) < 34
    assert 46 < max(delays_ms) <= 48
    in_a_burst = [link.feedback(START_NS + 201 * NS_PER_S + n, "gt") for n in range(50)]
    assert in_a_burst == sorted(in_a_burst)


def test_time_does_not_go_back():
    link = Link(Network(), UnlimitedCapacity(), VIEWS, 1)
    link.offer(START_NS, "eih", PacketKind.MEDIA, 100, 0)
    with pytest.raises(ValueError, match="order of time"):
        link.offer(START_NS - 1, "eih", PacketKind.MEDIA, 100, 1)


# --- which packets are lost ---------------------------------------------------------------------

LONG_RUN = 200_000


def losses(probability, mean_burst):
    model = loss_model(probability, mean_burst, Random(3))
    return [model.lost() for _ in range(LONG_RUN)]


def mean_run(lost):
    runs = [len(list(run)) for fate, run in groupby(lost) if fate]
    return sum(runs) / len(runs)


@pytest.mark.parametrize("probability", [0.003, 0.01, 0.2])
@pytest.mark.parametrize("mean_burst", [1.0, 3.0, 8.0])
def test_the_long_run_loss_is_the_one_asked_for(probability, mean_burst):
    share = sum(losses(probability, mean_burst)) / LONG_RUN
    # four standard errors of the mean, widened by the correlation within bursts
    tolerance = 4 * (probability * (2 * mean_burst) / LONG_RUN) ** 0.5
    assert abs(share - probability) < tolerance


@pytest.mark.parametrize(
    ("mean_burst", "run", "within"), [(3.0, 3.0, 0.1), (8.0, 8.0, 0.1), (1.0, 1 / 0.98, 0.02)]
)
def test_losses_come_in_bursts_of_the_mean_length_and_independent_ones_in_none(
    mean_burst, run, within
):
    assert mean_run(losses(0.02, mean_burst)) == pytest.approx(run, rel=within)


@pytest.mark.parametrize("mean_burst", [1.0, 4.0])
@pytest.mark.parametrize(("probability", "lost"), [(0.0, 0), (1.0, LONG_RUN)])
def test_none_and_all_mean_none_and_all(probability, lost, mean_burst):
    assert sum(losses(probability, mean_burst)) == lost


def test_impossible_bursts_are_refused_by_the_model_and_the_configuration():
    with pytest.raises(ValueError, match="such short bursts"):
        GilbertElliottLoss(0.9, 2.0, Random(0))
    with pytest.raises(ValueError, match="cannot come in bursts of 2"):
        Network(loss=0.9, loss_burst=2.0)
    assert Network(loss=0.9, loss_burst=9.1).loss_burst == 9.1
