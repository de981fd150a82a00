"""The session's side of the SSIM helper: hands frames over, takes their scores."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from tams_app.records import Frame, FrameQuality
from tams_app.runtime.process import HelperProcess
from tams_app.station.mount_memory import MountMemory, mount_specification
from tams_app.video.live.frame_ring import CAPTURED, FrameBlock
from tams_app.video.live.reporting_helper import ReportingHelper

_STOP_TIMEOUT_S = 9.0  # it may score for .7 s more, at the lowest priority


class QualityClient:
    """One SSIM helper; `push_capture` costs one conversion to luma into shared memory (.1 ms).

    Push a view's captures from one thread, each before it is sent. `on_quality` and `on_failure`
    are called in the reading thread, `on_quality` once per captured frame. The helper's end is a
    failure of the measurement only.
    """

    def __init__(
        self,
        shown: FrameBlock,
        *,
        log_directory: Path | None,
        on_quality: Callable[[FrameQuality], None],
        on_failure: Callable[[str, BaseException], None],
        mount: MountMemory | None = None,
    ) -> None:
        """`shown`: the memory of the frames shown, which the caller fills and closes.

        `mount`: that of the cameras whose frames are corrected.
        """
        self._shown, self._mount = shown, mount
        self._captured = FrameBlock(replace(shown.layout, kind=CAPTURED))
        self._helper = ReportingHelper(
            "quality",
            "tams_app.station.quality_process",
            log_directory=log_directory,
            report_type=FrameQuality,
            on_report=on_quality,
            on_failure=on_failure,
            ended_unasked="the SSIM helper ended unasked, so frames are no longer compared; "
            "start a new session if you need their quality",
            stop_timeout_s=_STOP_TIMEOUT_S,
        )
        self._stack = ExitStack()

    def start(self) -> None:
        """Start the helper and wait until it works; HelperError or OSError if it cannot."""
        layout, mount = self._shown.layout, self._mount
        with ExitStack() as stack:
            stack.callback(self._captured.close)
            self._captured.create()
            self._shown.create()
            stack.callback(self._helper.close)
            self._helper.start(
                {
                    "captured_memory": self._captured.name,
                    "shown_memory": self._shown.name,
                    **mount_specification(mount),
                    "views": layout.views,
                    "width": layout.width,
                    "height": layout.height,
                }
            )
            self._captured.hide()
            self._stack = stack.pop_all()

    @property
    def process(self) -> HelperProcess | None:
        """The helper; None before the start."""
        return self._helper.process

    def push_capture(self, frame: Frame) -> None:
        """Hand over a captured frame; before the start and after the end it is left out."""
        self._captured.put(frame.view, frame.index, frame.capture_ns, frame.image, task=frame.task)

    def close(self) -> None:
        """Let the helper finish and take its last results; may be called twice.

        Call it when nothing is pushed any more.
        """
        self._stack.close()
