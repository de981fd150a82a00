"""Sleeping on a word of shared memory."""

from __future__ import annotations

import mmap
import threading
import time

import numpy as np
import pytest

from tams_app.runtime import futex
from tams_app.runtime.shared_ring import create_block, new_block_name, open_block, remove_block
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.waiting

PATIENCE_NS = 10 * NS_PER_S


def word(memory: mmap.mmap) -> futex.Word:
    return np.frombuffer(memory, np.uint32, 1)


def test_a_word_that_has_changed_is_not_waited_for() -> None:
    with mmap.mmap(-1, 4096) as memory:
        started_ns = time.monotonic_ns()
        futex.wait(word(memory), 1, PATIENCE_NS)
        assert time.monotonic_ns() - started_ns < PATIENCE_NS


def test_nothing_is_waited_for_longer_than_the_timeout() -> None:
    with mmap.mmap(-1, 4096) as memory:
        started_ns = time.monotonic_ns()
        futex.wait(word(memory), 0, 20 * NS_PER_MS)
        futex.wait(word(memory), 0, 0)
        futex.wait(word(memory), 0, -1)
        assert 20 * NS_PER_MS <= time.monotonic_ns() - started_ns < PATIENCE_NS


def test_all_that_wait_are_woken_also_those_that_may_only_read() -> None:
    name = new_block_name()
    written = create_block(name, 4096)
    reading = [open_block(name) for _ in range(3)]
    remove_block(name)
    waiting = [
        threading.Thread(target=lambda block=block: futex.wait(word(block), 0, PATIENCE_NS))
        for block in reading
    ]
    started_ns = time.monotonic_ns()
    for thread in waiting:
        thread.start()
    time.sleep(0.05)
    written[0] = 1
    futex.wake(word(written))
    for thread in waiting:
        thread.join()
    assert time.monotonic_ns() - started_ns < PATIENCE_NS
    for block in (written, *reading):
        block.close()
