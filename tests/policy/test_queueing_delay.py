"""A queue told from jitter, by delays on two clocks."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from tams_app.policy.budget.queueing_delay import QueueingDelay
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

BURST_NS, STEP_NS = 11 * NS_PER_MS, 50 * NS_PER_MS


def steps(jitter_ms: float, seed: int, queue_from_s: float = 1e9) -> Iterator[QueueingDelay]:
    """After each policy step of a minute, where order is kept; a queue of 60 ms from then."""
    delay, random = QueueingDelay(), Random(seed)
    delivered_ns, next_ns = 0, STEP_NS
    for sent_ns in range(0, 60 * NS_PER_S, BURST_NS):
        way_ms = 400 + random.uniform(-jitter_ms, jitter_ms)
        way_ms += 60 if sent_ns >= queue_from_s * NS_PER_S else 0
        delivered_ns = max(delivered_ns, sent_ns + round(way_ms * NS_PER_MS))
        delay.add(sent_ns, delivered_ns)
        if sent_ns >= next_ns:
            next_ns += STEP_NS
            delay.step(sent_ns, 3000.0)
            yield delay


@pytest.mark.parametrize("jitter_ms", [0, 8, 25, 50])
def test_jitter_seldom_looks_like_a_queue(jitter_ms: float) -> None:
    for seed in range(3):
        found = [d.queue_ns > 1.5 * max(d.spread_ns, 4 * NS_PER_MS) for d in steps(jitter_ms, seed)]
        assert sum(found[200:]) < 0.04 * len(found[200:])


@pytest.mark.parametrize("jitter_ms", [0, 8, 25])
def test_a_queue_is_seen_within_half_a_second(jitter_ms: float) -> None:
    found = [delay.queue_ns for delay in steps(jitter_ms, 1, queue_from_s=30)]
    at = round(30 * NS_PER_S / STEP_NS)
    assert max(found[at - 20 : at - 1]) < 40 * NS_PER_MS
    assert found[at + 10] > 40 * NS_PER_MS
