"""Which packets are awaited, and which need not be."""

from __future__ import annotations

import pytest

from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.wait_idle import IdleGate, IdleWaiter

pytestmark = pytest.mark.untimed


class CountingWaiter(IdleWaiter):
    """Counts instead of waiting."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = 0

    def wait(self) -> None:
        self.waits += 1


class WaitedForClock(SteppedClock):
    """A clock on which a jitter buffer waits if the test says so."""

    waiting_until_ns: int | None = None

    def next_ns(self) -> int | None:
        return self.waiting_until_ns


@pytest.fixture
def waiter() -> CountingWaiter:
    return CountingWaiter()


@pytest.fixture
def clock() -> WaitedForClock:
    return WaitedForClock(1)


@pytest.fixture
def gate(waiter: CountingWaiter, clock: WaitedForClock) -> IdleGate:
    return IdleGate(waiter, clock)


def feed(gate: IdleGate, in_order: bool = True, ends_frame: bool = False) -> bool:
    gate.packet_enters(in_order, ends_frame)
    return gate.wait_if_due()


def test_the_middle_of_a_frame_is_not_awaited(gate: IdleGate, waiter: CountingWaiter) -> None:
    assert not feed(gate)
    assert not feed(gate)
    assert waiter.waits == 0


def test_the_end_of_a_frame_is_awaited_once(gate: IdleGate, waiter: CountingWaiter) -> None:
    feed(gate)
    assert feed(gate, ends_frame=True)
    assert waiter.waits == 1
    assert not gate.wait_if_due()


def test_a_gap_is_awaited_before_and_after(gate: IdleGate, waiter: CountingWaiter) -> None:
    feed(gate)
    gate.packet_enters(in_order=False, ends_frame=False)
    assert waiter.waits == 1
    assert gate.wait_if_due()
    assert waiter.waits == 2


def test_while_a_jitter_buffer_waits_every_packet_is_awaited(
    gate: IdleGate, waiter: CountingWaiter, clock: WaitedForClock
) -> None:
    clock.waiting_until_ns = 10
    assert feed(gate)
    clock.waiting_until_ns = None
    assert not feed(gate)
