"""The video of one trial in virtual time, and its scores; beside it `robot.senders`, live."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import Frame, PacketRecord, ShownFrame
from tams_app.robot.ground import Ground
from tams_app.robot.video import TakeFrame, Video
from tams_app.session.quality import task_regions
from tams_app.video.core.quality import Correction, Fate, Scorer, ViewQuality
from tams_app.video.core.ssim import luma_of
from tams_app.video.live.networks import resolve_network
from tams_app.video.virtual.shared import VideoRecord
from tams_app.video.virtual.video import VirtualVideo


class FrameScores:
    """The accounts of all views; each captured frame's record comes once its fate is decided.

    Every frame is scored: nothing is left out where time waits. `regions`: of the task, in the
    frames that are captured.
    """

    def __init__(self, config: Config, log: Journal, corrections: Mapping[str, Correction]) -> None:
        """`corrections`: by view, what the screen shows of a frame that is corrected."""
        scored = config.video.views if config.video.quality.enabled else ()
        self._views = {
            view: (ViewQuality(view, correct=corrections.get(view)), Scorer()) for view in scored
        }
        self._log, self.regions = log, task_regions(config)

    def captured(self, frame: Frame) -> None:
        """A camera's frame, in the order of capture."""
        if frame.view in self._views:
            accounts, _ = self._views[frame.view]
            luma = luma_of(frame.image)
            task = self.regions.of(frame.view)
            fates = accounts.captured(frame.index, frame.capture_ns, luma, task)
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
            self._log.record(scorer.score(fate))


class TrialVideo(Video):
    """All views of one trial over its network; `advance_to` lets them happen."""

    def __init__(
        self,
        ground: Ground,
        shown: Callable[[ShownFrame], None],
        captured: TakeFrame | None = None,
    ) -> None:
        """Start the chains; SetupError if GStreamer lacks something.

        `captured` gets each camera's frame before it is sent, and `shown` each decoded one, after
        the captures that came before it.
        """
        config, epoch_ns = ground.config, ground.clock.now_ns()
        network = resolve_network(config, config.network)
        super().__init__(ground, network, epoch_ns, captured)
        self._shown = shown
        self._chains = VirtualVideo(
            self._streams,
            network,
            self.rule,
            config.seed,
            epoch_ns,
            self._uplink,
        )

    def advance_to(self, now_ns: int) -> None:
        """Let everything happen to the video that is due up to `now_ns`."""
        self._keep(self._chains.advance_to(now_ns))

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        self._chains.set_targets(target_kbps)

    def pad(self, size_bytes: int) -> None:
        self._keep(self._chains.pad(size_bytes))

    def close(self) -> None:
        """Stop the chains; may be called twice."""
        self._chains.close()

    def _send(self, frame: Frame, left_out: bool) -> None:
        self._keep(self._chains.push(frame, left_out))

    def _wire_bytes(self) -> int:
        return self._chains.wire_bytes()

    def _keep(self, records: list[VideoRecord]) -> None:
        for record in records:
            if isinstance(record, PacketRecord):
                self._log.packets((record,))
            elif isinstance(record, ShownFrame):
                self._shown(record)
            else:
                self._log.record(record)
