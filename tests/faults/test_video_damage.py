"""Frames lost behind a real encoder, in virtual time: what is predicted from them counts as old."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from hw.gstreamer.camera import GstCamera
from tams_app.config import VideoConfig, load_config
from tams_app.errors import DeviceError
from tams_app.records import Frame, Image, ShownFrame
from tams_app.robot.control import Signals
from tams_app.robot.ground import Ground
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.video import TrialVideo
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faults.bench import ACROSS, PERIOD_NS
from tests.faults.braking import TICKS_TO_REST, comes_to_rest
from tests.faults.chain import HEIGHT, VIEWS, WIDTH, NoLog
from tests.faults.frames import PICTURE_DELAY_NS
from tests.faults.promises import is_logged
from tests.faults.test_video_freeze import HOLD_NS, expected_scale
from tests.faults.virtual_bench import VirtualBench
from tests.hw.gstreamer.damaged_videos import cut, mjpeg
from tests.hw.gstreamer.test_camera import PlayedSource

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(300)]

PRIMARY = "gt"  # in the phase REACH, in which the arm stays
START_NS = NS_PER_S
FRAME_NS = NS_PER_S // 30
OUTAGE_MS, OUTAGE_FOR_MS = 4500, 400


class LossyVideo:
    """A `Sight`: three views in virtual time over a link that loses all for a moment."""

    def __init__(self, folder: Path, pli: bool) -> None:
        trace = folder / "outage.csv"
        trace.write_text(f"t_ms,kbps\n0,6000\n{OUTAGE_MS},0\n{OUTAGE_MS + OUTAGE_FOR_MS},6000\n")
        config = load_config(
            None,
            {
                "video.width": WIDTH,
                "video.height": HEIGHT,
                "video.quality.enabled": False,
                "video.repair.pli": pli,
                "video.repair.mode": "paper",
                "policy.budget.mode": "oracle",
                "networks.lossy": {"latency_ms": 40, "jitter_ms": 8, "trace": str(trace)},
                "network": "lossy",
            },
        )
        clock = VirtualClock(START_NS)
        log = NoLog(clock)
        self.operator = VirtualOperator(config, 0, log, {})
        self.video = TrialVideo(Ground(config, clock, log, Signals()), self._show)
        self._newest_ns: int | None = None  # capture of what the primary view shows
        self._random = np.random.default_rng(5)
        self._index = 0
        self.now_ns = START_NS

    def advance(self, duration_ns: int) -> None:
        """Let time pass; each camera has a frame 30 times a second."""
        end_ns = self.now_ns + duration_ns
        while (due_ns := START_NS + self._index * FRAME_NS) <= end_ns:
            self.video.advance_to(due_ns)
            image = self._image()
            for view in VIEWS:
                self.video.push(Frame(view, self._index, due_ns, image))
            self._index += 1
        self.video.advance_to(end_ns)
        self.now_ns = end_ns

    def _image(self) -> Image:
        """All of it changes, so that the frames are large enough to overflow the queue."""
        coarse = self._random.integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), np.uint8)
        return np.ascontiguousarray(np.repeat(np.repeat(coarse, 8, axis=0), 8, axis=1))

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Of what counts, by the clock of the video."""
        return self.operator.age_ns(view, self.now_ns)

    def is_damaged(self, view: str) -> bool:
        return self.operator.is_damaged(view)

    def newest_age_ns(self) -> int:
        """Of the newest frame on the screen, whatever it shows."""
        assert self._newest_ns is not None
        return self.now_ns - self._newest_ns

    def _show(self, shown: ShownFrame) -> None:
        if shown.view == PRIMARY:
            self._newest_ns = shown.capture_ns
        self.operator.see(shown)


class WatchedBench(VirtualBench):
    """A bench whose frames go through the link while time passes."""

    def __init__(self, folder: Path, video: LossyVideo) -> None:
        self._lossy = video
        super().__init__(folder=folder, sight=video)

    def _let_pass(self, duration_ns: int) -> None:
        super()._let_pass(duration_ns)
        self._lossy.advance(duration_ns)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


def steered_through_the_outage(
    folder: Path, stack: ExitStack, pli: bool
) -> tuple[WatchedBench, LossyVideo, int]:
    """The arm moves when all is lost for a moment; the tick in which frames are shown again."""
    video = LossyVideo(folder, pli)
    stack.callback(video.video.close)
    video.advance(NS_PER_S)
    bench = WatchedBench(folder, video)
    stack.callback(bench.close)
    bench.engage_and_move(0.05 * ACROSS, seconds=0.2)
    assert video.now_ns < START_NS + OUTAGE_MS * NS_PER_MS
    while video.now_ns < START_NS + (OUTAGE_MS + OUTAGE_FOR_MS) * NS_PER_MS:
        bench.tick()
        assert bench.outputs[-1].arming is ArmingState.ENGAGED
    while video.newest_age_ns() > 200 * NS_PER_MS:
        bench.tick()
    return bench, video, bench.next


def test_while_keyframe_requests_are_dropped_the_arm_is_held_though_frames_are_shown(
    tmp_path: Path, stack: ExitStack
) -> None:
    bench, video, back = steered_through_the_outage(tmp_path, stack, pli=False)
    age_ns = video.age_ns(PRIMARY, 0)
    assert age_ns is not None
    assert age_ns < HOLD_NS
    most_ticks = (HOLD_NS - age_ns) // PERIOD_NS + 2
    bench.run_until(lambda output: output.arming is not ArmingState.ENGAGED, within=most_ticks)
    held = bench.next - 1
    assert bench.outputs[held].arming is ArmingState.HOLDING
    assert bench.outputs[held].reason is Reason.VIDEO_DAMAGED
    for tick, output in zip(bench.ticks[back:held], bench.outputs[back:held], strict=True):
        assert tick.inputs is not None
        assert tick.inputs.video_age_ns is not None
        scale = expected_scale(tick.inputs.video_age_ns)
        assert output.speed_scale == pytest.approx(scale, abs=1e-9)
    bench.run(0.3)
    assert comes_to_rest(bench, held, steady=False) <= TICKS_TO_REST
    bench.hand.trigger = 0.0
    bench.run(2.0)
    assert video.newest_age_ns() < 200 * NS_PER_MS, "frames are shown all the time"
    assert bench.outputs[-1].arming is ArmingState.HOLDING, "and none of them counts"
    is_logged(bench, Reason.VIDEO_DAMAGED)


@pytest.mark.verify
def test_with_keyframe_requests_the_chain_is_whole_again_before_the_arm_is_held(
    tmp_path: Path, stack: ExitStack
) -> None:
    bench, video, back = steered_through_the_outage(tmp_path, stack, pli=True)
    bench.run(1.0)
    assert {output.arming for output in bench.outputs[back:]} == {ArmingState.ENGAGED}
    assert not video.is_damaged(PRIMARY)
    assert (video.age_ns(PRIMARY, 0) or HOLD_NS) < 200 * NS_PER_MS


class CameraSight:
    """A `Sight`: the primary view's frames as a real camera chain let them pass, once it began."""

    def __init__(self, passed_ns: list[int]) -> None:
        """`passed_ns`: when each was taken, from the first one on."""
        self._passed_ns = passed_ns
        self.began_ns: int | None = None

    def age_ns(self, view: str, now_ns: int) -> int | None:
        if view != PRIMARY or self.began_ns is None:
            return PICTURE_DELAY_NS
        since_ns = now_ns - self.began_ns
        shown_ns = [one for one in self._passed_ns if one + PICTURE_DELAY_NS <= since_ns]
        return since_ns - max(shown_ns, default=-PICTURE_DELAY_NS)

    def is_damaged(self, view: str) -> bool:
        return False


def passed_by_a_camera(folder: Path, frames: int, whole: int) -> list[int]:
    """When frames were taken, from the first on; from number `whole` on their JPEGs are cut off."""
    mjpeg(folder / "camera.mkv", frames, cut, range(whole, frames))
    source = PlayedSource(
        f"filesrc location={folder / 'camera.mkv'} ! matroskademux ! image/jpeg ! jpegdec "
        "! identity sync=true",
        DeviceError("over"),
    )
    small = VideoConfig(width=160, height=120)
    camera = GstCamera(PRIMARY, source, small, MonotonicClock(), lambda *_: None)
    camera.start()
    found = []
    while not camera.trouble:
        frame = camera.next_frame(0.1)
        if frame is not None:
            found.append(frame.capture_ns)
    camera.close()
    return [one - found[0] for one in found]


def test_a_camera_whose_frames_arrive_damaged_holds_the_arm_like_one_that_gives_none(
    tmp_path: Path, stack: ExitStack
) -> None:
    passed_ns = passed_by_a_camera(tmp_path, frames=60, whole=15)
    assert passed_ns[-1] < 15 * FRAME_NS
    sight = CameraSight(passed_ns)
    bench = VirtualBench(folder=tmp_path, sight=sight)
    stack.callback(bench.close)
    bench.engage_and_move(0.05 * ACROSS, seconds=0.2)
    sight.began_ns = bench.ticks[-1].started_ns
    within = (passed_ns[-1] + HOLD_NS) // PERIOD_NS + 2
    bench.run_until(lambda output: output.arming is not ArmingState.ENGAGED, within=within)
    held = bench.next - 1
    assert bench.outputs[held].arming is ArmingState.HOLDING
    assert bench.outputs[held].reason is Reason.STALE_VIDEO
    assert bench.ticks[held].started_ns - sight.began_ns > passed_ns[-1] + HOLD_NS - 2 * PERIOD_NS
    bench.run(0.5)
    assert comes_to_rest(bench, held) <= TICKS_TO_REST
    is_logged(bench, Reason.STALE_VIDEO)
