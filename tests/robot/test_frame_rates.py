"""Who loses frames, what is told of it, and the rig's cameras on a machine that cannot keep up."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hw.sim.viewpoints import VIEWS
from hw.sim.world.renderer import CameraSchedule
from hw.sim.world.rig_memory import FrameShape, FrameWriter, remove_memory
from tams_app.config import load_config
from tams_app.records import CameraRates, Frame
from tams_app.robot.frame_rates import FrameRates
from tams_app.robot.rate_ladder import RateLadder
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

IMAGE = np.zeros((2, 2, 3), np.uint8)
TICK_NS = NS_PER_S // 120


class Bench:
    """Counted frames and ticks under a virtual clock."""

    def __init__(self, ladder: RateLadder | None, **overrides: Any) -> None:
        self.clock = VirtualClock()
        self.asked: list[float] = []
        self.records: list[CameraRates] = []
        self.notes: list[tuple[str, str]] = []
        self.behind_ns = self.polls = 0
        self.drained_every = 1 << 30  # polls
        self.rates = FrameRates(
            load_config(None, overrides),
            self.clock,
            ladder,
            self.asked.append,
            self._encoders_behind_ns,
            self.records.append,
            lambda level, text: self.notes.append((level, text)),
        )
        self.damaged: dict[str, int] = {}  # by view, before each of its frames
        self.push_ns = 0
        self.take = self.rates.through(lambda _: self.clock.advance_ns(self.push_ns))
        self.ticks = 0

    def _encoders_behind_ns(self) -> int:
        self.polls += 1
        return self.behind_ns if self.polls % self.drained_every else 0

    def frame(self, view: str, index: int, capture_ns: int) -> None:
        self.take(Frame(view, index, capture_ns, IMAGE, damaged=self.damaged.get(view, 0)))

    def tick(self, late_ns: int = 0, skipped: int = 0) -> None:
        due_ns = self.clock.now_ns()
        self.rates.on_tick(
            SimpleNamespace(due_ns=due_ns, started_ns=due_ns + late_ns, skipped=skipped)  # type: ignore[arg-type]
        )

    def seconds(self, count: int, step: int = 1, late: float = 0.0) -> None:
        """Every `step`-th of 30 frames a second and view, and the share `late` of late ticks."""
        for _ in range(count * 30):
            now_ns, number = self.clock.now_ns(), self.ticks
            for view in VIEWS if number % step == 0 else ():
                self.frame(view, number, now_ns)
            for part in range(4):
                self.tick(2 * NS_PER_MS if (4 * number + part) % 100 < 100 * late else 0)
            self.ticks += 1
            self.clock.advance_ns(NS_PER_S // 30 + 1)
            self.rates.poll()


def test_all_that_was_asked_for_is_counted_and_nobody_is_told() -> None:
    bench = Bench(None)
    bench.seconds(10)
    assert bench.rates.given_fps == pytest.approx(dict.fromkeys(VIEWS, 30.0), rel=0.04)
    assert bench.notes == []
    assert 8 <= len(bench.records) <= 10
    assert {one.asked_fps for one in bench.records} == {30.0}


def test_a_real_camera_at_half_its_rate_is_told_of_once_and_never_slowed() -> None:
    bench = Bench(None, **HARDWARE)
    bench.seconds(20, step=2)
    assert bench.asked == []
    ((level, sentence),) = bench.notes
    assert level == "warning"
    assert "eih 15.0, gt 15.0, gs 15.0 per second of 30. The cameras delivered no more" in sentence
    bench.seconds(5)
    bench.seconds(10, step=2)
    assert len(bench.notes) == 2


def test_damaged_frames_are_counted_by_view_and_told_as_what_is_short() -> None:
    bench = Bench(None, **HARDWARE)
    bench.damaged = {"gs": 1}
    bench.seconds(8, step=2)
    assert bench.records[-1].damaged["eih"] == 0
    assert bench.records[-1].damaged["gs"] == pytest.approx(15, abs=1)
    ((_, sentence),) = bench.notes
    assert "of gs) and were left out: check the cables" in sentence


HARDWARE = {"rig.enabled": False, "cameras": {view: {"source": "pattern"} for view in VIEWS}}


def test_frames_that_were_there_before_anybody_waited_count_against_the_application() -> None:
    bench = Bench(None, **HARDWARE)
    start_ns = bench.clock.now_ns()
    for number in range(100):  # every third frame of each view, 20 ms after its capture
        bench.clock.sleep_until_ns(start_ns + number * 100 * NS_PER_MS)
        capture_ns = bench.clock.now_ns() - 20 * NS_PER_MS
        bench.tick()
        for view in ("eih", "gs", "gt"):
            bench.push_ns = 90 * NS_PER_MS if view == "gt" else 0
            bench.frame(view, 3 * number, capture_ns)
        bench.rates.poll()
    last = bench.records[-1]
    assert last.given_fps == pytest.approx(dict.fromkeys(VIEWS, 10.0), rel=0.15)
    assert last.overrun_fps == pytest.approx({"eih": 0.0, "gt": 20.0, "gs": 0.0}, rel=0.15)


def test_lasting_late_ticks_slow_the_rigs_cameras_and_are_told_with_the_reason() -> None:
    bench = Bench(RateLadder(30.0))
    bench.seconds(6, late=0.05)
    assert bench.asked == [20.0]
    ((level, text),) = bench.notes
    assert level == "warning"
    assert text.startswith("the cameras now run at 20 instead of 30 frames per second: ")
    (step,) = [one for one in bench.records if one.reason]
    assert (step.asked_fps, step.reason) == (20.0, text.split(": ")[1])


def test_frames_that_wait_for_an_encoder_all_the_time_slow_the_rigs_cameras() -> None:
    bench = Bench(RateLadder(30.0))
    bench.behind_ns = 70 * NS_PER_MS
    bench.seconds(6)
    assert bench.asked == [20.0]
    assert "frames waited for an encoder" in bench.notes[0][1]


def test_frames_that_wait_for_an_encoder_now_and_then_do_not() -> None:
    bench = Bench(RateLadder(30.0))
    bench.behind_ns = 70 * NS_PER_MS
    bench.drained_every = 25
    bench.seconds(10)
    assert bench.asked == []


def test_a_source_that_stands_still_is_a_matter_of_stale_video_and_not_of_the_rate() -> None:
    bench = Bench(RateLadder(30.0, 15.0))
    bench.seconds(2)
    bench.seconds(12, step=10_000)
    bench.seconds(1)
    assert bench.asked == []


def test_a_rate_below_the_asked_one_from_the_start_is_on_record_with_its_reason() -> None:
    bench = Bench(RateLadder(30.0, 15.0))
    bench.seconds(3)
    assert bench.records[0].asked_fps == 15.0
    assert "measured" in bench.records[0].reason


@pytest.fixture
def writer() -> Iterator[FrameWriter]:
    name = new_block_name()
    writer = FrameWriter(name, FrameShape(VIEWS, 16, 8))
    yield writer
    writer.close()
    remove_memory(name)


def test_on_a_machine_that_draws_too_slowly_the_frames_settle_evenly_and_come_back(
    writer: FrameWriter,
) -> None:
    """The real schedule, counters and ladder; drawing costs time under a virtual clock."""
    ladder = RateLadder(30.0)
    bench = Bench(ladder)
    clock = bench.clock
    schedule = CameraSchedule(writer, ladder.fps, clock.now_ns())
    captures: dict[str, list[int]] = {view: [] for view in VIEWS}

    def run(seconds: int, drawing_ns: int) -> None:
        end_ns = clock.now_ns() + seconds * NS_PER_S
        while clock.now_ns() < end_ns:
            schedule.keep_to(ladder.fps)
            camera = schedule.next(clock.now_ns())
            clock.sleep_until_ns(camera.due_ns)
            captures[camera.view].append(clock.now_ns())
            clock.advance_ns(drawing_ns)
            bench.frame(camera.view, camera.next_index, captures[camera.view][-1])
            camera.taken()
            bench.tick()
            bench.rates.poll()

    run(20, drawing_ns=25 * NS_PER_MS)  # 13 sets a second
    for times in captures.values():
        intervals_ns = np.diff([t_ns for t_ns in times if t_ns > clock.now_ns() - 4 * NS_PER_S])
        assert np.percentile(intervals_ns, 95) <= 1.5 * NS_PER_S / 10
    assert min(bench.asked) >= 7.5
    run(120, drawing_ns=5 * NS_PER_MS)
    assert ladder.fps == 30.0
    for times in captures.values():
        intervals_ns = np.diff([t_ns for t_ns in times if t_ns > clock.now_ns() - 4 * NS_PER_S])
        assert np.percentile(intervals_ns, 95) <= 1.5 * NS_PER_S / 30
    assert all(b > a for times in captures.values() for a, b in pairwise(times))
