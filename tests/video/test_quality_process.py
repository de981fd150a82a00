"""The SSIM helper, in this process with our clock and as a process of its own, and its pace."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.records import Frame, FrameQuality, Image, Pose
from tams_app.runtime.parts import Parts
from tams_app.runtime.shared_ring import open_block
from tams_app.session.quality import LiveQuality, TaskRegions
from tams_app.station.mount_memory import MountMemory
from tams_app.station.quality_process import (
    LARGEST_SHARE,
    LEAST_SHARE,
    WAITING_FATES,
    SparePace,
    ViewScores,
    run,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim
from tams_app.video.live.frame_ring import CAPTURED, SHOWN, FrameBlock, FrameReader, RingLayout
from tests.faults.applications import until
from tests.prediction.wrist import above, camera_of, lens_of, picture, placed

pytestmark = pytest.mark.waiting

WIDTH, HEIGHT = 96, 64
FRAME_NS = 33 * NS_PER_MS
WORK_NS = 10 * NS_PER_MS


def image(index: int) -> Image:
    coarse = np.random.default_rng(index).integers(0, 255, (8, 12, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (WIDTH, HEIGHT)), np.uint8)


def blurred(index: int) -> Image:
    return np.asarray(cv2.GaussianBlur(image(index), (0, 0), 2), np.uint8)


def expected(captured: int, shown: int) -> float:
    return ssim(FrameMoments.of(luma_of(image(captured))), FrameMoments.of(luma_of(blurred(shown))))


class Bench:
    """One view's scores over its two rings, driven by hand."""

    def __init__(self, stack: ExitStack) -> None:
        readers = []
        blocks = [
            FrameBlock(RingLayout(kind, ("gt",), WIDTH, HEIGHT)) for kind in (CAPTURED, SHOWN)
        ]
        for block in blocks:
            stack.callback(block.close)
            block.create()
            memory = stack.enter_context(open_block(block.name))
            readers.append(FrameReader(memory, block.layout, "gt"))
        self.captured, self.shown = blocks
        self.told: list[FrameQuality] = []
        self.scores = ViewScores("gt", *readers, self.told.append)

    def frame(self, index: int, shown: bool = True) -> None:
        self.captured.put("gt", index, index * FRAME_NS, image(index))
        if shown:
            self.shown.put("gt", index, index * FRAME_NS + NS_PER_MS, blurred(index))


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack)


def test_without_time_frames_are_left_out_evenly_but_not_unreported(bench: Bench) -> None:
    for index in range(90):
        bench.frame(index)
        bench.scores.take_in()
        if index % 3 == 0:
            bench.scores.score_next()
    bench.scores.leave_out()
    assert sorted(one.index for one in bench.told) == list(range(90))
    scored = [one.index for one in bench.told if one.received is not None]
    assert len(scored) == 30
    assert max(np.diff(scored)) <= 4
    assert scored[-1] > 90 - WAITING_FATES - 4  # it keeps up with the present


def test_a_helper_that_slept_still_knows_what_was_shown(bench: Bench) -> None:
    for index in range(200):
        bench.frame(index, shown=index % 2 == 0)
    bench.scores.take_in()
    bench.scores.finish(200 * FRAME_NS)
    bench.scores.leave_out()
    assert [one.index for one in bench.told if one.shown_ns is None] == list(range(1, 200, 2))
    assert len(bench.told) == 200


def test_at_the_end_time_is_limited_and_every_frame_is_told(bench: Bench) -> None:
    class HurryingClock:
        now = 0

        def now_ns(self) -> int:
            self.now += 100 * NS_PER_MS
            return self.now

        def sleep_until_ns(self, t_ns: int) -> None:
            raise AssertionError

    for index in range(12):
        bench.frame(index)
    stop = threading.Event()
    stop.set()
    run([bench.scores], HurryingClock(), SparePace(lambda: 1.0, 0), stop)
    assert sorted(one.index for one in bench.told) == list(range(12))
    assert 3 <= sum(one.received is not None for one in bench.told) <= 8


class Pushed:
    """The measurement of a session, what its helper says, and the memory of the frames shown."""

    def __init__(self, logs: Path, mount: MountMemory | None = None) -> None:
        self.records: list[FrameQuality] = []
        self.notes: list[str] = []
        self.screen = FrameBlock(RingLayout(SHOWN, ("eih", "gt"), WIDTH, HEIGHT))
        self.parts = Parts(logs, pytest.fail, 0)
        screen: Any = SimpleNamespace(frames=self.screen, mount=mount)
        note = lambda _level, text: self.notes.append(text)  # noqa: E731
        log: Any = SimpleNamespace(record=self.records.append, note=note)
        config = load_config(None, {"video.quality.enabled": True}).video
        self.client = LiveQuality(config, self.parts, screen, log, TaskRegions({}, {}))

    def start(self) -> int:
        """The helper's process id."""
        self.client.start()
        return self.parts.pids["quality"]

    def push(self, index: int, shown: bool = True) -> None:
        for view in ("eih", "gt"):
            self.client.captured(Frame(view, index, index * FRAME_NS, image(index)))
            if shown:
                self.screen.put(view, index, index * FRAME_NS + NS_PER_MS, blurred(index))

    def await_records(self, count: int) -> None:
        until(lambda: len(self.records) >= count, "the frames' records")

    def close(self) -> None:
        self.client.close()
        self.screen.close()


@pytest.fixture
def pushed(tmp_path: Path) -> Iterator[Pushed]:
    with closing(Pushed(tmp_path)) as pushed:
        yield pushed


def blocks() -> set[str]:
    """Names of shared memory that this process has made."""
    return {path.name for path in Path("/dev/shm").glob(f"tams-{os.getpid()}-*")}


def ports_of(pid: int) -> set[int]:
    """Of the internet's protocols."""
    return {one.laddr.port for one in psutil.Process(pid).net_connections(kind="inet")}


def test_the_helper_tells_what_became_of_every_frame_through_no_port(pushed: Pushed) -> None:
    before = ports_of(os.getpid())
    pushed.push(0)  # before the start: left out
    pid = pushed.start()
    assert blocks() == {pushed.screen.name}  # the session's, which others may read as well
    pushed.screen.hide()
    assert blocks() == set()  # nothing that a killed session could leave behind
    assert os.sched_getscheduler(pid) == os.SCHED_IDLE
    for index in range(1, 11):
        pushed.push(index)
        pushed.await_records(2 * index)
    assert (ports_of(os.getpid()), ports_of(pid)) == (before, set())
    pushed.push(11, shown=False)
    pushed.close()
    pushed.close()
    pushed.push(12)  # after the end: left out
    for view in ("eih", "gt"):
        mine = [one for one in pushed.records if one.view == view]
        assert [one.index for one in mine] == list(range(1, 12))
        assert [one.received for one in mine[:10]] == [
            pytest.approx(expected(index, index)) for index in range(1, 11)
        ]
        assert mine[10].shown_ns is None
        # at the lowest priority it may come to nothing in what time it has left
        assert mine[10].delivered in (None, pytest.approx(expected(11, 10)))
    assert pushed.notes == []
    assert pushed.client._helper.process.exit_code == 0


def test_a_view_that_is_corrected_is_live_as_it_is_drawn(tmp_path: Path) -> None:
    """The camera glides over a pattern; each frame is drawn two frames later."""
    cameras, lens = {"eih": camera_of(WIDTH, HEIGHT)}, lens_of(WIDTH, HEIGHT)
    late_ns = 2 * FRAME_NS

    def flange(t_ns: int) -> Pose:
        return above(0.15 * t_ns / 1e9, 0.0, 0.2)

    with closing(MountMemory(cameras)) as mount, closing(Pushed(tmp_path, mount)) as pushed:
        pushed.start()
        for step in range(150):
            t_ns = step * 8 * NS_PER_MS
            mount.put(placed(t_ns, flange(t_ns - late_ns), flange(t_ns), late_ns))
        for index in range(12, 30):
            now_ns = index * FRAME_NS
            seen = picture(lens, flange(now_ns))
            then_ns = now_ns - late_ns
            for view in ("eih", "gt"):
                pushed.client.captured(Frame(view, index, now_ns, seen))
                late = picture(lens, flange(then_ns))
                pushed.screen.put(view, index - 2, now_ns + NS_PER_MS, late, then_ns)
        pushed.await_records(20)
    live = {
        view: [one.live for one in pushed.records if one.view == view and one.live is not None]
        for view in ("eih", "gt")
    }
    assert len(live["eih"]) > 5
    assert min(live["eih"][2:]) > max(live["gt"][2:]) + 0.05


def paced(idles: list[float]) -> list[float]:
    """The share after each look at the machine."""
    at = iter(idles)
    pace = SparePace(lambda: next(at), 0)
    shares = []
    for second in range(1, len(idles) + 1):
        pace.rest_ns(WORK_NS, second * NS_PER_S)
        shares.append(pace.share)
    return shares


def test_it_begins_with_little_and_grows_to_half_a_core_where_cores_are_idle() -> None:
    shares = paced([0.4] * 20)
    assert shares[0] < 0.1
    assert shares == sorted(shares)
    assert shares[-1] == LARGEST_SHARE


def test_a_full_machine_halves_it_at_each_look_down_to_a_few_frames_a_second() -> None:
    shares = paced([0.4] * 20 + [0.0] * 5)
    assert shares[20:23] == [0.25, 0.125, 0.0625]
    assert shares[-1] == LEAST_SHARE


def test_between_scarce_and_ample_it_stays() -> None:
    assert len(set(paced([0.07] * 5))) == 1


def test_the_machine_is_looked_at_twice_a_second_however_short_the_work() -> None:
    looks = []

    def idle() -> float:
        looks.append(1)
        return 0.5

    pace = SparePace(idle, 0)
    for step in range(1, 101):
        pace.rest_ns(WORK_NS, step * 10 * NS_PER_MS)
    assert len(looks) == 2


@given(st.lists(st.floats(0, 1), max_size=40), st.integers(0, NS_PER_S))
def test_work_never_takes_more_than_half_of_the_time(idles: list[float], worked_ns: int) -> None:
    at = iter([*idles, 1.0])
    pace = SparePace(lambda: next(at), 0)
    for second in range(1, len(idles) + 2):
        rest_ns = pace.rest_ns(worked_ns, second * NS_PER_S)
        assert rest_ns >= worked_ns
        assert LEAST_SHARE <= pace.share <= LARGEST_SHARE
