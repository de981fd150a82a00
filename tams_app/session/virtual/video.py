"""The video of one trial in virtual time, and its scores; beside it `robot.senders`, live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import Frame, FrameQuality, ShownFrame
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock
from tams_app.video.core.quality import Correction, Fate, Scorer, ViewQuality
from tams_app.video.core.ssim import luma_of
from tams_app.video.live.networks import resolve_network
from tams_app.video.virtual.shared import VideoRecords
from tams_app.video.virtual.video import VirtualVideo


class FrameScores:
    """The accounts of `views`; each captured frame's record comes once its fate is decided.

    Every frame is scored: nothing is left out where time waits. Frames of other views are ignored.
    """

    def __init__(
        self,
        views: Iterable[str],
        record: Callable[[FrameQuality], None],
        corrections: Mapping[str, Correction],
    ) -> None:
        """`corrections`: by view, what the screen shows of a frame that is corrected."""
        self._views = {
            view: (ViewQuality(view, correct=corrections.get(view)), Scorer()) for view in views
        }
        self._record = record

    def captured(self, frame: Frame) -> None:
        """A camera's frame, in the order of capture."""
        if frame.view in self._views:
            accounts, _ = self._views[frame.view]
            luma = luma_of(frame.image)
            fates = accounts.captured(frame.index, frame.capture_ns, luma, frame.task)
            self._score(frame.view, fates)

    def shown(self, shown: ShownFrame) -> None:
        """A frame that reached the screen, after the captures that came before it."""
        if shown.view in self._views:
            accounts, _ = self._views[shown.view]
            fates = accounts.shown(shown.index, shown.shown_ns, luma_of(shown.image))
            self._score(shown.view, fates)

    def finish(self, end_ns: int) -> None:
        """Nothing more comes."""
        for view, (accounts, _) in self._views.items():
            self._score(view, accounts.finish(end_ns))

    def _score(self, view: str, fates: list[Fate]) -> None:
        scorer = self._views[view][1]
        for fate in fates:
            self._record(scorer.score(fate))


class TrialVideo(Video):
    """All views of one trial over its network; `advance_to` lets them happen."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        log: Journal,
        on_captured: Callable[[Frame], None],
        on_shown: Callable[[ShownFrame], None],
    ) -> None:
        """Start the chains; SetupError if GStreamer lacks something.

        `on_shown` gets each decoded frame, after the captures that came before it.
        """
        epoch_ns = clock.now_ns()
        network = resolve_network(config, config.network)
        super().__init__(config, network, clock, epoch_ns, log, on_captured)
        self._chains = VirtualVideo(
            self._streams,
            network,
            self._rule,
            config.seed,
            epoch_ns,
            VideoRecords(log.record, log.record, on_shown, log.packets),
            self._uplink,
        )

    def advance_to(self, now_ns: int) -> None:
        """Let everything happen to the video that is due up to `now_ns`."""
        self._chains.advance_to(now_ns)

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        self._chains.set_targets(target_kbps)

    def pad(self, size_bytes: int) -> None:
        self._chains.pad(size_bytes)

    def poll(self) -> str:
        return ""  # a chain that fails raises

    def close(self) -> None:
        self._chains.close()

    def _send(self, frame: Frame, left_out: bool) -> None:
        self._chains.push(frame, left_out)

    def _wire_bytes(self) -> int:
        return self._chains.wire_bytes()
