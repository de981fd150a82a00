"""Which packets are awaited, and which need not be."""

from __future__ import annotations

import pytest

from tams_app.video.virtual_time.idle import Rest
from tams_app.video.virtual_time.stepped_clock import SteppedClock
from tams_app.video.virtual_time.wait_idle import Quiescence

pytestmark = pytest.mark.untimed


class CountingQuiescence(Quiescence):
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
def quiescence() -> CountingQuiescence:
    return CountingQuiescence()


@pytest.fixture
def clock() -> WaitedForClock:
    return WaitedForClock(1)


@pytest.fixture
def rest(quiescence: CountingQuiescence, clock: WaitedForClock) -> Rest:
    return Rest(quiescence, clock)


def feed(rest: Rest, in_order: bool = True, ends_frame: bool = False) -> bool:
    rest.disturb(in_order, ends_frame)
    return rest.wait_if_due()


def test_the_middle_of_a_frame_is_not_awaited(rest: Rest, quiescence: CountingQuiescence) -> None:
    assert not feed(rest)
    assert not feed(rest)
    assert quiescence.waits == 0


def test_the_end_of_a_frame_is_awaited_once(rest: Rest, quiescence: CountingQuiescence) -> None:
    feed(rest)
    assert feed(rest, ends_frame=True)
    assert quiescence.waits == 1
    assert not rest.wait_if_due()


def test_a_gap_is_awaited_before_and_after(rest: Rest, quiescence: CountingQuiescence) -> None:
    feed(rest)
    rest.disturb(in_order=False, ends_frame=False)
    assert quiescence.waits == 1
    assert rest.wait_if_due()
    assert quiescence.waits == 2


def test_while_a_jitter_buffer_waits_every_packet_is_awaited(
    rest: Rest, quiescence: CountingQuiescence, clock: WaitedForClock
) -> None:
    clock.waiting_until_ns = 10
    assert feed(rest)
    clock.waiting_until_ns = None
    assert not feed(rest)
