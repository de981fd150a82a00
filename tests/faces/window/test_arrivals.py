"""The window is woken by new frames of the large picture's view."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from tams_app.faces.window.picture import Arrivals
from tams_app.runtime.shared_ring import open_block
from tams_app.runtime.worker import Worker
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, FrameReader, RingLayout

pytestmark = pytest.mark.waiting

LAYOUT = RingLayout(SHOWN, ("eih", "gt"), 8, 6)
IMAGE = np.zeros((6, 8, 3), np.uint8)
PATIENCE_S, SILENCE_S = 20.0, 0.3


class Woken:
    """What wakes, and how often it has."""

    def __init__(self, block: FrameBlock) -> None:
        memory = open_block(block.name)
        readers = {view: FrameReader(memory, LAYOUT, view) for view in LAYOUT.views}
        self.calls: queue.SimpleQueue[None] = queue.SimpleQueue()
        self.arrivals = Arrivals(readers, "eih")

    def run(self, stop: threading.Event) -> None:
        for _ in self.arrivals.until(stop):
            self.calls.put(None)

    def is_woken(self, within_s: float = PATIENCE_S) -> bool:
        try:
            self.calls.get(timeout=within_s)
        except queue.Empty:
            return False
        return True


@pytest.fixture
def block() -> Iterator[FrameBlock]:
    block = FrameBlock(LAYOUT)
    block.create()
    yield block
    block.close()


@pytest.fixture
def woken(block: FrameBlock) -> Iterator[Woken]:
    woken = Woken(block)
    worker = Worker("arrivals", woken.run)
    worker.start()
    yield woken
    worker.stop()
    assert worker.failure is None


def test_each_frame_of_the_view_wakes(block: FrameBlock, woken: Woken) -> None:
    for index in range(3):
        block.put("eih", index, index, IMAGE)
        assert woken.is_woken()
    assert not woken.is_woken(SILENCE_S)


def test_another_view_may_become_the_large_one(block: FrameBlock, woken: Woken) -> None:
    woken.arrivals.view = "gt"
    block.put("gt", 0, 0, IMAGE)
    assert woken.is_woken()
    block.put("eih", 0, 0, IMAGE)
    assert not woken.is_woken(SILENCE_S)
