"""How many frames came, how many were missed by the application, and how many were damaged."""

from __future__ import annotations

import numpy as np
import pytest

from hw.sim.layout import VIEWS
from tams_app.records import Frame
from tams_app.robot.senders import FrameRates
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.untimed

IMAGE = np.zeros((2, 2, 3), np.uint8)


class Bench:
    """Counted frames under a virtual clock."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        log = MemoryJournal(self.clock)
        self.records = log.records
        self.rates = FrameRates(VIEWS, self.clock, log)
        self.damaged: dict[str, int] = {}  # by view, before each of its frames
        self.push_ns = 0

    def frame(self, view: str, index: int, capture_ns: int) -> None:
        damaged = self.damaged.get(view, 0)
        self.rates.came(Frame(view, index, capture_ns, IMAGE, damaged=damaged))
        self.clock.advance_ns(self.push_ns)
        self.rates.waits(view)

    def seconds(self, count: int, step: int = 1) -> None:
        """Every `step`-th of 30 frames a second and view."""
        for number in range(count * 30):
            for view in VIEWS if number % step == 0 else ():
                self.frame(view, number, self.clock.now_ns())
            self.clock.advance_ns(NS_PER_S // 30 + 1)
            self.rates.poll()


@pytest.mark.parametrize("step", [1, 2])
def test_frames_are_counted_by_view_once_a_second(step: int) -> None:
    bench = Bench()
    bench.seconds(10, step)
    given = dict.fromkeys(VIEWS, 30.0 / step)
    assert bench.rates.given_fps == pytest.approx(given, rel=0.04)
    assert bench.records[-1].given_fps == bench.rates.given_fps
    assert 8 <= len(bench.records) <= 10


def test_damaged_frames_are_counted_by_view() -> None:
    bench = Bench()
    bench.damaged = {"gs": 1}
    bench.seconds(8, step=2)
    assert bench.records[-1].damaged["eih"] == 0
    assert bench.records[-1].damaged["gs"] == pytest.approx(15, abs=1)


def test_frames_that_were_there_before_they_were_waited_for_count_against_the_application() -> None:
    bench = Bench()
    start_ns = bench.clock.now_ns()
    for number in range(100):  # every third frame of each view, 20 ms after its capture
        bench.clock.sleep_until_ns(start_ns + number * 100 * NS_PER_MS)
        capture_ns = bench.clock.now_ns() - 20 * NS_PER_MS
        for view in ("eih", "gs", "gt"):
            bench.push_ns = 90 * NS_PER_MS if view == "gt" else 0
            bench.frame(view, 3 * number, capture_ns)
        bench.rates.poll()
    last = bench.records[-1]
    assert last.given_fps == pytest.approx(dict.fromkeys(VIEWS, 10.0), rel=0.15)
    assert last.overrun_fps == pytest.approx({"eih": 0.0, "gt": 20.0, "gs": 0.0}, rel=0.15)
