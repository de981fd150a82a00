"""Waiting for every other thread, not for ever, and only where it matters."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import pytest

from tams_app.errors import TamsError
from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.wait_idle import IdleGate, IdleWaiter

pytestmark = pytest.mark.waiting


@pytest.fixture
def waiter() -> Iterator[IdleWaiter]:
    made = IdleWaiter()
    yield made
    made.close()


def test_it_waits_until_a_busy_thread_has_done_its_work(waiter: IdleWaiter) -> None:
    done = threading.Event()
    go, end = threading.Event(), threading.Event()

    def work() -> None:
        go.wait()
        sum(range(3_000_000))
        done.set()
        end.wait()

    thread = threading.Thread(target=work)
    thread.start()
    waiter.wait()  # it sleeps, so this returns
    assert not done.is_set()
    go.set()
    waiter.wait()
    assert done.is_set()
    end.set()
    thread.join()


def test_a_thread_that_is_never_idle_is_an_error_and_not_a_hang() -> None:
    stop = threading.Event()

    def spin() -> None:
        while not stop.is_set():
            pass

    thread = threading.Thread(target=spin)
    thread.start()
    impatient = IdleWaiter(timeout_s=0.2)
    try:
        with pytest.raises(TamsError, match=r"did not become idle within 0\.2 s"):
            impatient.wait()
    finally:
        stop.set()
        thread.join()
        impatient.close()


def test_threads_that_come_and_go_are_followed(waiter: IdleWaiter) -> None:
    for _ in range(5):
        thread = threading.Thread(target=lambda: sum(range(10_000)))
        thread.start()
        waiter.wait()
        thread.join()
        waiter.wait()


def test_closing_gives_every_file_back() -> None:
    before = len(os.listdir("/proc/self/fd"))
    with_files = IdleWaiter()
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    with_files.wait()
    with_files.close()
    with_files.close()
    end.set()
    thread.join()
    assert len(os.listdir("/proc/self/fd")) == before


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
def counting() -> CountingWaiter:
    return CountingWaiter()


@pytest.fixture
def clock() -> WaitedForClock:
    return WaitedForClock(1)


@pytest.fixture
def gate(counting: CountingWaiter, clock: WaitedForClock) -> IdleGate:
    return IdleGate(counting, clock)


def feed(gate: IdleGate, in_order: bool = True, ends_frame: bool = False) -> bool:
    gate.packet_enters(in_order, ends_frame)
    return gate.wait_if_due()


def test_the_middle_of_a_frame_is_not_awaited(gate: IdleGate, counting: CountingWaiter) -> None:
    assert not feed(gate)
    assert not feed(gate)
    assert counting.waits == 0


def test_the_end_of_a_frame_is_awaited_once(gate: IdleGate, counting: CountingWaiter) -> None:
    feed(gate)
    assert feed(gate, ends_frame=True)
    assert counting.waits == 1
    assert not gate.wait_if_due()


def test_a_gap_is_awaited_before_and_after(gate: IdleGate, counting: CountingWaiter) -> None:
    feed(gate)
    gate.packet_enters(in_order=False, ends_frame=False)
    assert counting.waits == 1
    assert gate.wait_if_due()
    assert counting.waits == 2


def test_while_a_jitter_buffer_waits_every_packet_is_awaited(
    gate: IdleGate, counting: CountingWaiter, clock: WaitedForClock
) -> None:
    clock.waiting_until_ns = 10
    assert feed(gate)
    clock.waiting_until_ns = None
    assert not feed(gate)
