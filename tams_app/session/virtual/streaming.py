"""From the cameras to the operator's eyes in virtual time; beside it `session.streaming`, live."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tams_app.config import Config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Frame, Image, Phase, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.session import build
from tams_app.session.allocating import Allocating
from tams_app.session.captures import CaptureTimes
from tams_app.session.recorders import SessionRecords
from tams_app.session.uplink import primary_age_ns
from tams_app.session.virtual.scoring import FrameScores
from tams_app.video.networks import network_capacity, resolve_network
from tams_app.video.repair import repair_rule
from tams_app.video.virtual_time.shared import VideoRecords
from tams_app.video.virtual_time.video import VirtualVideo


class VirtualStreaming:
    """All views of one trial over its network, the policy that feeds them, and their scores."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        records: SessionRecords,
        watch: Callable[[ShownFrame], None],
    ) -> None:
        """Start the chains; SetupError if GStreamer lacks something. `watch` sees what is shown."""
        video, epoch_ns = config.video, clock.now_ns()
        network = resolve_network(config, config.network)
        rule = repair_rule(network, video.pli_min_interval_ms, video.repair)
        allocating = Allocating(config, network_capacity(network, epoch_ns), records)
        self._records = records
        self._watch = watch
        scored = video.views if video.quality.enabled else ()
        self._scores = FrameScores(scored, records.record)
        self._times = {view: CaptureTimes() for view in video.views}
        self._weights = WeightMatrix(config.policy.weights.matrix)
        self._video = VirtualVideo(
            video,
            network,
            rule,
            config.seed,
            epoch_ns,
            allocating.start_kbps(epoch_ns),
            config.policy.allocation.source_drop_below_kbps,
            VideoRecords(records.record, records.record, self._on_shown, records.packets),
        )
        self.policy = allocating.loop(clock, self._video)
        self.video_delay_ns = build.video_delay_ns(network, rule)

    def push(self, frame: Frame) -> None:
        """A camera has handed over a frame: send it."""
        self._records.capture(frame)
        self._scores.captured(frame)
        self._times[frame.view].add(frame.index, frame.capture_ns)
        self._video.push(frame)

    def advance_to(self, now_ns: int) -> None:
        """Let everything happen to the video that is due up to `now_ns`."""
        self._video.advance_to(now_ns)

    def frames(self) -> Mapping[str, Image | None]:
        """What is on the operator's screen, by view; None before the first frame."""
        shown = {view: self._video.shown(view) for view in self._times}
        return {view: None if one is None else one.image for view, one in shown.items()}

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the frame shown of `view`; None before the first."""
        return self._times[view].age_ns(self._video.shown(view), now_ns)

    @property
    def primary_age_ns(self) -> Callable[[int, Phase], int]:
        """Tells the age of the shown primary view of a phase at a time [ns]."""
        return primary_age_ns(self, self._weights.primary_view)

    def finish(self, now_ns: int) -> None:
        """Nothing more is shown: score what is left."""
        self._scores.finish(now_ns)

    def close(self) -> None:
        """End the chains; may be called twice."""
        self._video.close()

    def _on_shown(self, shown: ShownFrame) -> None:
        self._records.record(shown)
        self._scores.shown(shown)
        self._watch(shown)
