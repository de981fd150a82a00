"""The session's side of the SSIM helper: hands frames over, takes their scores."""

from __future__ import annotations

import mmap
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tams_app.records import Frame, FrameQuality, ShownFrame
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import create_block, new_block_name, remove_block
from tams_app.video.frame_ring import CAPTURED, KINDS, SHOWN, FrameWriter, RingLayout
from tams_app.video.reporting_helper import ReportingHelper

_STOP_TIMEOUT_S = 9.0  # it may score for .7 s more, at the lowest priority


class QualityClient:
    """One SSIM helper; `push_*` cost one conversion to luma into shared memory (.1 ms).

    Push a view's captures from one thread and its shown frames from one thread; a capture before
    it is sent. `on_quality` and `on_failure` are called in the reading thread, `on_quality` once
    per captured frame. The helper's end is a failure of the measurement only.
    """

    def __init__(
        self,
        views: tuple[str, ...],
        width: int,
        height: int,
        *,
        log_directory: Path | None,
        on_quality: Callable[[FrameQuality], None],
        on_failure: Callable[[str, BaseException], None],
    ) -> None:
        self._layout = RingLayout(views, width, height)
        self._helper = ReportingHelper(
            "quality",
            "tams_app.video.quality_process",
            log_directory=log_directory,
            report_type=FrameQuality,
            on_report=on_quality,
            on_failure=on_failure,
            ended_unasked="the SSIM helper ended unasked, so frames are no longer compared; "
            "start a new session if you need their quality",
            stop_timeout_s=_STOP_TIMEOUT_S,
        )
        self._writers: dict[tuple[str, str], FrameWriter] = {}
        self._stack = ExitStack()

    def start(self) -> None:
        """Start the helper and wait until it works; HelperError if it cannot."""
        with ExitStack() as stack:
            name = new_block_name() + "-quality"
            block = create_block(name, self._layout.block_bytes)
            stack.callback(self._let_go, block)
            stack.callback(remove_block, name)
            stack.callback(self._helper.close)
            self._helper.start(
                {
                    "memory_name": name,
                    "views": self._layout.views,
                    "width": self._layout.width,
                    "height": self._layout.height,
                }
            )
            remove_block(name)  # both have it: nothing is left behind however we end
            self._stack = stack.pop_all()
        self._writers = {
            (view, kind): FrameWriter(block, self._layout, view, kind)
            for view in self._layout.views
            for kind in KINDS
        }

    @property
    def process(self) -> HelperProcess | None:
        """The helper; None before the start."""
        return self._helper.process

    def push_capture(self, frame: Frame) -> None:
        """Hand over a captured frame; before the start and after the end it is left out."""
        if writer := self._writers.get((frame.view, CAPTURED)):
            writer.put(frame.index, frame.capture_ns, frame.image)

    def push_shown(self, shown: ShownFrame) -> None:
        """Hand over a shown frame; before the start and after the end it is left out."""
        if writer := self._writers.get((shown.view, SHOWN)):
            writer.put(shown.index, shown.shown_ns, shown.image)

    def close(self) -> None:
        """Let the helper finish and take its last results; may be called twice.

        Call it when nothing is pushed any more.
        """
        self._stack.close()

    def _let_go(self, block: mmap.mmap) -> None:
        self._writers = {}
        block.close()
