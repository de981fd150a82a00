"""The operator's side of the video: receivers, whose packets come by the link."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack

from tams_app.config import VideoConfig
from tams_app.link.gateway import Routes
from tams_app.records import ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.session.faces import Faces
from tams_app.session.fresh_video import FreshVideo, SteeredBy
from tams_app.units import NS_PER_S
from tams_app.video.core.codecs import Decoder
from tams_app.video.core.frame_identity import SentFrame, capture_of
from tams_app.video.core.packets import stream_ssrcs
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.receiver import VideoReceiver
from tams_app.video.live.udp import ViewPorts

_RATE_NS = NS_PER_S


class OperatorVideo:
    """The newest frame of each view. Its `index` is the RTP timestamp, which both sides know.

    `capture_ns` is on the robot's clock, from what the robot's side says of its first frame; until
    it has, no frame is shown.
    """

    def __init__(
        self,
        config: VideoConfig,
        rule: RepairRule,
        feedback: bool,
        clock: Clock,
        on_shown: Callable[[ShownFrame], None],
        decoder: Decoder,
        robot_now_ns: Callable[[], int | None],
        faces: Faces,
    ) -> None:
        """`robot_now_ns`: about what the robot's clock shows now, None before that is known.

        `faces`: what shows the frames.
        """
        self._views = config.views
        self._clock = clock
        self._on_shown = on_shown
        self._robot_now_ns = robot_now_ns
        self._fresh = FreshVideo(config.views, faces)
        self._first_ns: dict[str, int | None] = dict.fromkeys(config.views)
        self._times: dict[str, deque[int]] = {view: deque(maxlen=200) for view in config.views}
        self._stack = ExitStack()
        self._receivers: dict[str, VideoReceiver] = {}
        for view in config.views:
            receiver = VideoReceiver(
                view, config, rule, clock, self._finder(view), self._shown, feedback, decoder
            )
            self._stack.callback(receiver.close)
            self._receivers[view] = receiver
        self._config = config

    def start(self, entrance_port: int) -> Routes:
        """Begin to receive; feedback goes to `entrance_port`. The ports for what comes."""
        rtp: dict[int, int] = {}
        rtcp: dict[int, int] = {}
        host = self._config.bind_host
        for view, receiver in self._receivers.items():
            receiver.start(ViewPorts(host, 0, 0, entrance_port))
            for ssrc in stream_ssrcs(self._config, view):
                rtp[ssrc], rtcp[ssrc] = receiver.rtp_port, receiver.reports_port
        return Routes(rtp, rtcp)

    def first_captures(self, first_ns: tuple[int | None, ...]) -> None:
        """When each view's frame with RTP timestamp 0 was captured, on the robot's clock."""
        self._first_ns.update(zip(self._views, first_ns, strict=False))

    def shown(self, view: str) -> ShownFrame | None:
        """The newest frame of `view`; None before the first."""
        return self._receivers[view].mailbox.latest()

    def steered_by(self, view: str) -> SteeredBy:
        """What the operator can steer by in this view now."""
        return self._fresh.of(view)

    def shown_fps(self, view: str) -> float:
        """Frames of `view` shown over the last second."""
        since_ns = self._clock.now_ns() - _RATE_NS
        return float(sum(t_ns > since_ns for t_ns in tuple(self._times[view])))

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return next(filter(None, (one.poll() for one in self._receivers.values())), "")

    def close(self) -> None:
        """Stop all; may be called twice."""
        self._stack.close()

    def _finder(self, view: str) -> Callable[[int], SentFrame | None]:
        def find(timestamp: int) -> SentFrame | None:
            first_ns, now_ns = self._first_ns[view], self._robot_now_ns()
            if first_ns is None or now_ns is None:
                return None
            return SentFrame(timestamp, capture_of(timestamp, first_ns, now_ns), 0)

        return find

    def _shown(self, shown: ShownFrame) -> None:
        self._fresh.shown(shown)
        self._times[shown.view].append(shown.shown_ns)
        self._on_shown(shown)
