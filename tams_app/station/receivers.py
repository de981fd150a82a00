"""The video on the operator's side: a receiver for each view, and which frame counts of each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import TypeAlias

from msgspec.structs import replace

from tams_app.config import VideoConfig
from tams_app.records import LatencyState, ShownFrame, SteeredBy, ViewState
from tams_app.runtime.clock import Clock
from tams_app.station.fresh_video import Displays, FreshVideo
from tams_app.station.screen import Screen
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrame
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.stages import StageMeans, together
from tams_app.video.live.receiver import VideoReceiver
from tams_app.video.live.udp import ViewPorts

# which capture an RTP timestamp stands for; None: not shown
Identify: TypeAlias = Callable[[int], SentFrame | None]


class Receivers:
    """The newest frame of each view. Bound when made; `start`, `poll`, in the end `close`."""

    def __init__(
        self,
        config: VideoConfig,
        rule: RepairRule,
        feedback: bool,
        clock: Clock,
        identify: Mapping[str, Identify],
        screen: Screen,
        displays: Displays,
    ) -> None:
        """`identify`: by view. `displays`: what shows the frames of `screen` to a person."""
        self._clock = clock
        self._screen = screen
        self._fresh = FreshVideo(config.views, displays)
        self._times: dict[str, deque[int]] = {view: deque(maxlen=200) for view in config.views}
        self._stages = {view: StageMeans() for view in config.views}
        self._newest: dict[str, ShownFrame] = {}
        self._receivers: dict[str, VideoReceiver] = {}
        with ExitStack() as stack:  # where one cannot bind, the others let go of their ports
            for view in config.views:
                receiver = VideoReceiver(
                    view, config, rule, clock, identify[view], self._shown, feedback
                )
                stack.callback(receiver.close)
                self._receivers[view] = receiver
            self._stack = stack.pop_all()

    @property
    def ports(self) -> dict[str, ViewPorts]:
        """By view, where its packets must arrive."""
        return {view: one.ports for view, one in self._receivers.items()}

    def start(self, entrances: Mapping[str, ViewPorts]) -> None:
        """Begin to receive; feedback goes to `entrances`, by view."""
        for view, receiver in self._receivers.items():
            receiver.start(entrances[view])

    def shown(self, view: str) -> ShownFrame | None:
        """The newest frame of `view`; None before the first."""
        return self._newest.get(view)

    def steered_by(self, view: str) -> SteeredBy:
        """The frame of this view that the operator can steer by now."""
        return self._fresh.of(view)

    def shown_fps(self, view: str) -> float:
        """Frames of `view` shown over the last second."""
        since_ns = self._clock.now_ns() - NS_PER_S
        return float(sum(t_ns > since_ns for t_ns in tuple(self._times[view])))

    def latency(self, view: str) -> LatencyState | None:
        """What the frames of `view` take here once their packets have come."""
        return self._stages[view].latency

    def views(
        self, robots: Mapping[str, ViewState], now_ns: int, offset_ns: int | None
    ) -> dict[str, ViewState]:
        """All views, as the robot's side knows them and as they are shown here.

        `offset_ns`: the robot's clock minus ours; None: not known.
        """
        return {
            view: self._view(view, robots.get(view, ViewState()), now_ns, offset_ns)
            for view in self._receivers
        }

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return next(filter(None, (one.poll() for one in self._receivers.values())), "")

    def close(self) -> None:
        """Stop all; may be called twice."""
        self._stack.close()

    def _shown(self, shown: ShownFrame) -> None:
        self._newest[shown.view] = shown
        self._fresh.shown(shown)
        self._times[shown.view].append(shown.shown_ns)
        self._stages[shown.view].step("decoder", shown.received_ns, shown.shown_ns)
        self._screen.show(shown)

    def _view(self, view: str, robots: ViewState, now_ns: int, offset_ns: int | None) -> ViewState:
        shown = self.shown(view)
        latency_ms = age_ms = None
        if offset_ns is not None:
            steered_ns = self.steered_by(view).capture_ns
            if steered_ns is not None:
                age_ms = (now_ns + offset_ns - steered_ns) / NS_PER_MS
            if shown is not None:
                latency_ms = (shown.shown_ns + offset_ns - shown.capture_ns) / NS_PER_MS
        fps = self.shown_fps(view)
        own = together(robots.own, self.latency(view))
        return replace(robots, shown_fps=fps, latency_ms=latency_ms, age_ms=age_ms, own=own)
