"""The frames' quality while a session runs, also where they show the task: measured beside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace

import msgspec
import numpy as np

from tams_app.config import Config, VideoConfig
from tams_app.errors import TamsError
from tams_app.recording.journal import Journal
from tams_app.records import Frame, FrameQuality, Lens, Record, TaskRegion, Tick, Vector, ViewState
from tams_app.robot.listener import Listener
from tams_app.runtime.parts import Parts
from tams_app.session.viewing import scene_of, tool_tip
from tams_app.station.screen import Screen, mount_specification
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import CAPTURED, FrameBlock
from tams_app.video.live.reporting_helper import ReportingHelper

RADIUS_M = 0.06  # of the ball: the fingers, what they hold, and as much before them
LEAST_RADIUS_PX = 40.0  # a smaller disc would be few of the encoder's blocks of 16 pixels


class TaskRegions(Listener):
    """The region of the task in a frame that is captured now, by the newest state of the arm.

    What matters in pick and place is at the gripper: its fingers, what they hold or are about to
    hold, and what is right below. The region is the disc in which a camera sees a ball about the
    tool centre point, so no picture is looked at to find it, and it is the same whatever the
    picture shows. The state is a few milliseconds older or newer than the frame, in which the arm
    moves less than a millimetre or two.
    """

    def __init__(self, fixed: Mapping[str, Lens], wrist: Mapping[str, TaskRegion | None]) -> None:
        """By view: `fixed`, the lenses in the base frame; `wrist`, the regions of cameras that move
        with the tool, which therefore stays where it is in their pictures.
        """
        self._fixed, self._wrist = fixed, wrist
        self._tcp: Vector | None = None

    def receive(self, record: Record) -> None:
        """In the control thread; cameras' threads read it."""
        if isinstance(record, Tick) and record.arm is not None:
            self._tcp = record.arm.tcp.position

    def of(self, view: str) -> TaskRegion | None:
        """The region now; None: the camera or the arm is not known, or the tool is out of sight."""
        lens, tcp = self._fixed.get(view), self._tcp
        if lens is None or tcp is None:
            return self._wrist.get(view)
        return task_region(lens, tcp)


def task_regions(config: Config) -> TaskRegions:
    """Of the views whose cameras' poses are known."""
    scene = scene_of(config)
    if scene.figure is None:
        return TaskRegions({}, {})
    flange = scene.figure.flange
    tip = np.array(tool_tip(config, scene.figure))
    fixed, wrist = {}, {}
    for view, lens in scene.lenses.items():
        if lens.parent == flange:
            wrist[view] = task_region(lens, tip)
        else:
            fixed[view] = lens
    return TaskRegions(fixed, wrist)


def task_region(lens: Lens, tcp: Vector) -> TaskRegion | None:
    """The region that `lens` sees; None: the TCP is out of its sight.

    `tcp`: position in the frame of the lens's parent [m], shape (3,).
    """
    pixels = lens.projected(tcp.reshape(1, 3))
    if not len(pixels):
        return None
    x_px, y_px = pixels[0].tolist()
    if not (0.0 <= x_px < lens.width and 0.0 <= y_px < lens.height):
        return None
    depth_m = float(lens.pose.rotation.inv().apply(tcp - lens.pose.position)[2])
    radius_px = max(LEAST_RADIUS_PX, RADIUS_M * float(lens.matrix()[0, 0]) / depth_m)
    return TaskRegion(x_px, y_px, radius_px)


_STOP_TIMEOUT_S = 9.0  # it may score for .7 s more, at the lowest priority
RECENT_SCORES = 15
RECENT_NS = 3 * NS_PER_S  # a score comes up to a second after its frame


class LiveQuality:
    """The SSIM helper of one session; without a helper everything here does nothing.

    Whatever happens to the helper is noted and nothing else: no failure of the measurement ends
    a session or stops an arm.
    """

    def __init__(
        self,
        config: VideoConfig,
        parts: Parts,
        screen: Screen,
        log: Journal,
        regions: TaskRegions,
    ) -> None:
        """Of the frames on the `screen`; `regions` of the captured ones. The parts end it."""
        self._wanted = config.quality.enabled
        self._parts, self._log, self._regions = parts, log, regions
        self._shown, self._mount = screen.frames, screen.mount
        self._recent: dict[str, tuple[FrameQuality, ...]] = {}  # those with a live score
        self._captured = FrameBlock(replace(self._shown.layout, kind=CAPTURED))
        self._helper = ReportingHelper(
            "quality",
            "tams_app.station.quality_process",
            log_directory=parts.logs,
            report_type=FrameQuality,
            on_report=self._keep,
            on_failure=self._failed,
            ended_unasked="the SSIM helper ended unasked, so frames are no longer compared; "
            "start a new session if you need their quality",
            stop_timeout_s=_STOP_TIMEOUT_S,
        )
        self._stack = ExitStack()
        parts.stack.callback(self.close)

    def start(self) -> None:
        """Start the helper, if it is wanted, and wait until it works."""
        if not self._wanted:
            return
        try:
            self._launch()
        except (TamsError, OSError) as failure:
            self._failed("quality", failure)
            return
        process = self._helper.process
        if process is not None and process.pid is not None:
            self._parts.measure("quality", process.pid)

    def captured(self, frame: Frame) -> None:
        """Hand over a captured frame before it is sent; each view from one thread.

        That costs one conversion to luma into shared memory (.1 ms). Before the start and after the
        end it is left out.
        """
        task = self._regions.of(frame.view)
        self._captured.put(frame.view, frame.index, frame.capture_ns, frame.image, task=task)

    def views(self, views: Mapping[str, ViewState], now_ns: int) -> dict[str, ViewState]:
        """The views with the mean live SSIM of their last scored frames."""
        return {name: self._scored(name, view, now_ns) for name, view in views.items()}

    def _scored(self, name: str, view: ViewState, now_ns: int) -> ViewState:
        recent = [one for one in self._recent.get(name, ()) if now_ns - one.capture_ns <= RECENT_NS]
        return msgspec.structs.replace(
            view,
            live_ssim=_mean(one.live for one in recent),
            task_live_ssim=_mean(one.task_live for one in recent),
        )

    def close(self) -> None:
        """Take the last results, once no more frames are pushed; may be called twice."""
        try:
            self._stack.close()
        except (TamsError, OSError) as failure:
            self._failed("quality", failure)

    def _launch(self) -> None:
        layout = self._shown.layout
        with ExitStack() as stack:
            stack.callback(self._captured.close)
            self._captured.create()
            self._shown.create()
            stack.callback(self._helper.close)
            self._helper.start(
                {
                    "captured_memory": self._captured.name,
                    "shown_memory": self._shown.name,
                    **mount_specification(self._mount),
                    "views": layout.views,
                    "width": layout.width,
                    "height": layout.height,
                }
            )
            self._captured.hide()
            self._stack = stack.pop_all()

    def _keep(self, quality: FrameQuality) -> None:
        self._log.record(quality)
        if quality.live is not None:
            # replaced as a whole: the console reads it meanwhile
            before = self._recent.get(quality.view, ())[1 - RECENT_SCORES :]
            self._recent[quality.view] = (*before, quality)

    def _failed(self, _name: str, failure: BaseException) -> None:
        self._log.note("warning", f"the frames' quality is not measured: {failure}")


def _mean(scores: Iterable[float | None]) -> float | None:
    known = [one for one in scores if one is not None]
    return sum(known) / len(known) if known else None
