"""Waiting for every other thread, and not for ever."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import pytest

from tams_app.errors import TamsError
from tams_app.video.virtual.wait_idle import IdleWaiter

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
