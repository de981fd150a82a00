from __future__ import annotations

import os
import threading
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hw.sim.layout import HEIGHT_PX, VIEWS, WIDTH_PX
from hw.sim.world import renderer
from hw.sim.world.renderer import CameraSchedule
from hw.sim.world.rig_memory import FrameWriter, SimCamera
from tams_app.errors import HelperError
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import RENDERER_NICE
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.waiting

PERIOD_NS = NS_PER_S // 30
BLACK = np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
READY_DEG = [0, 36.81, 86.74, 0, 49.93, 0]


def test_views_take_turns_a_third_of_a_period_apart() -> None:
    schedule = CameraSchedule(30, now_ns=NS_PER_S)
    turns, now_ns = [], NS_PER_S
    for _ in range(9):
        camera = schedule.next(now_ns)
        turns.append((camera.view, camera.next_index, camera.due_ns))
        now_ns = camera.due_ns
        camera.taken()
    assert [turn[0] for turn in turns] == list(VIEWS) * 3
    assert [turn[1] for turn in turns] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    for before, after in pairwise(turns):
        assert after[2] - before[2] == pytest.approx(PERIOD_NS / 3, abs=2)


def test_missed_instants_are_left_out() -> None:
    schedule = CameraSchedule(30, now_ns=NS_PER_S)
    first = schedule.next(NS_PER_S)
    start_ns = first.due_ns
    latest = schedule.next(start_ns + 5 * PERIOD_NS + PERIOD_NS // 4)
    assert first.next_index == 5
    assert (latest.view, latest.next_index) == ("gt", 4)


@pytest.mark.parametrize("work_periods", [0.4, 0.7, 1.0, 1.9])
def test_where_time_is_short_no_view_misses_more_than_another(work_periods: float) -> None:
    schedule = CameraSchedule(30, now_ns=NS_PER_S)
    taken = dict.fromkeys(VIEWS, 0)
    now_ns = NS_PER_S
    for _ in range(200):
        camera = schedule.next(now_ns)
        now_ns = max(now_ns, camera.due_ns) + round(work_periods * PERIOD_NS)
        taken[camera.view] += 1
        camera.taken()
    assert max(taken.values()) - min(taken.values()) <= 2


class Drawing:
    """Images that take a time to draw, and a world that is always new."""

    def __init__(self, drawing_ns: int, frames: int) -> None:
        self.clock, self.stop = VirtualClock(), threading.Event()
        self._drawing_ns, self._left = drawing_ns, frames
        self.times: list[tuple[int, int]] = []

    def read(self) -> tuple[int, SimpleNamespace]:
        return self.clock.now_ns(), SimpleNamespace(qpos=None)

    def take(self, _view: str, _index: int, _qpos: object) -> Image:
        began_ns = self.clock.now_ns()
        self.clock.advance_ns(self._drawing_ns)
        self.times.append((began_ns, self.clock.now_ns()))
        if len(self.times) >= self._left:
            self.stop.set()
        return BLACK


@pytest.mark.parametrize("drawing_ms", [4, 10, 40])
def test_drawing_takes_at_most_two_thirds_of_the_time(writer: FrameWriter, drawing_ms: int) -> None:
    drawing: Any = Drawing(drawing_ms * NS_PER_MS, 60)
    renderer.run(drawing, drawing, writer, 30.0, drawing.clock, drawing.stop)
    times = drawing.times
    assert all(b[0] - a[1] >= (a[1] - a[0]) / 2 for a, b in pairwise(times))
    shortest_s = max(59 / 90, 59 * 1.5 * drawing_ms / 1000)  # as asked for, or as drawing allows
    assert (times[-1][0] - times[0][0]) / NS_PER_S == pytest.approx(shortest_s, rel=0.05)


def renderer_process(name: str, directory: Path) -> HelperProcess:
    specification = {"memory_name": name, "seed": 3, "fps": 30}
    return HelperProcess("renderer", "hw.sim.world.renderer", specification, directory)


def rig_process(name: str, directory: Path) -> HelperProcess:
    specification = {"memory_name": name, "seed": 3, "start_joints_deg": READY_DEG}
    return HelperProcess("rig", "hw.sim.rig", specification, directory)


def test_renderer_without_a_rig_says_so_in_one_sentence(name: str, tmp_path: Path) -> None:
    helper = renderer_process(name, tmp_path)
    helper.start()
    with pytest.raises(HelperError, match="start its processes"):
        helper.wait_ready()
    helper.stop()
    assert helper.exit_code == 1


def test_rig_and_renderer_deliver_every_view(name: str, tmp_path: Path) -> None:
    """The renderer is never real-time, so that a full machine keeps its control loop."""
    clock, rig, helper = MonotonicClock(), rig_process(name, tmp_path), None
    try:
        rig.start()
        ready = rig.wait_ready()
        assert ready["control_port"] > 0
        helper = renderer_process(name, tmp_path)
        helper.start()
        helper.wait_ready()
        assert helper.pid is not None
        assert os.sched_getscheduler(helper.pid) == os.SCHED_OTHER
        assert os.getpriority(os.PRIO_PROCESS, helper.pid) in (RENDERER_NICE, 10)
        for view in VIEWS:
            with closing(SimCamera(view, name, clock)) as camera:
                camera.start()
                for _ in range(3):
                    frame = camera.next_frame(10.0)
                    assert frame is not None
                    assert frame.image.shape == (HEIGHT_PX, WIDTH_PX, 3)
                    assert frame.image.std() > 10
                    assert frame.capture_ns <= clock.now_ns()
    finally:
        if helper is not None:
            helper.stop()
        rig.stop()
