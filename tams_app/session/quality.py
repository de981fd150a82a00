"""The frames' quality while a session runs: measured beside it, without holding it up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import msgspec

from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import Frame, FrameQuality, TakeNote, ViewState
from tams_app.station.mount_memory import MountMemory
from tams_app.station.quality_client import QualityClient
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import FrameBlock

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
        screen: FrameBlock,
        logs: Path,
        record: Callable[[FrameQuality], None],
        note: TakeNote,
        mount: MountMemory | None = None,
    ) -> None:
        """`screen`: where the frames shown are put, which the helper reads, as it does `mount`:
        where the cameras are whose frames are corrected.

        `record` gets one record per captured frame, in a thread of its own.
        """
        self._wanted = config.quality.enabled
        self._record = record
        self._note = note
        self._recent: dict[str, tuple[FrameQuality, ...]] = {}  # those with a live score
        self._started = False
        self._client = QualityClient(
            screen,
            log_directory=logs,
            on_quality=self._keep,
            on_failure=lambda _name, failure: self._report(failure),
            mount=mount,
        )

    def start(self) -> None:
        """Start the helper, if it is wanted, and wait until it works."""
        if not self._wanted:
            return
        try:
            self._client.start()
        except (TamsError, OSError) as failure:
            self._report(failure)
        else:
            self._started = True

    @property
    def pid(self) -> int | None:
        """The helper's process id; None where there is none."""
        process = self._client.process
        return process.pid if process is not None and self._started else None

    def captured(self, frame: Frame) -> None:
        """Hand over a captured frame before it is sent; each view from one thread."""
        self._client.push_capture(frame)

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
        """Take the last results, once no more frames are pushed."""
        try:
            self._client.close()
        except (TamsError, OSError) as failure:
            self._report(failure)

    def _keep(self, quality: FrameQuality) -> None:
        self._record(quality)
        if quality.live is not None:
            # replaced as a whole: the console reads it meanwhile
            before = self._recent.get(quality.view, ())[1 - RECENT_SCORES :]
            self._recent[quality.view] = (*before, quality)

    def _report(self, failure: BaseException) -> None:
        self._note("warning", f"the frames' quality is not measured: {failure}")


def _mean(scores: Iterable[float | None]) -> float | None:
    known = [one for one in scores if one is not None]
    return sum(known) / len(known) if known else None
