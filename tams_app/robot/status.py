"""The state of a running session, as the robot's side knows it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from msgspec.structs import replace

from tams_app.config import Config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import (
    Allocation,
    EpisodesState,
    LatencyState,
    Newest,
    PacketRecord,
    PolicyInputs,
    Record,
    SessionState,
    Tick,
    ViewState,
)
from tams_app.robot.control import SteadyVideo
from tams_app.robot.listener import Listener
from tams_app.robot.operator import Operator
from tams_app.robot.uplink_meter import WINDOW_NS, UplinkMeter
from tams_app.state import StateMaker
from tams_app.units import NS_PER_MS
from tams_app.video.core.uplink_figures import ReportedPackets, uplink_figures


class StatusBoard(Listener):
    """The uplink of the last second beside the newest records; read by console and link."""

    def __init__(self, config: Config, newest: Newest) -> None:
        """`newest`: of the session's log."""
        self._views, self._newest = (views := config.video.views), newest
        weights = WeightMatrix(config.policy.weights.matrix)
        self._maker = StateMaker(views, weights, config.video.fps)
        self._uplink, self._reported = UplinkMeter(views), ReportedPackets()
        self._figures = uplink_figures((), views, WINDOW_NS)

    def receive(self, record: Record) -> None:
        if isinstance(record, PolicyInputs):
            if not self._uplink.emulated:  # counting them takes as long as a step of the policy
                self._uplink.report(self._reported.step(record.report().arrivals))
        elif isinstance(record, Allocation):
            # in this thread: the control thread, too, asks for the state, and counts no packets
            self._figures = self._uplink.figures(record.t_ns)

    def packets(self, packets: list[PacketRecord]) -> None:
        """Newly decided packet fates."""
        self._uplink.packets(packets)

    def state(
        self,
        now_ns: int,
        elapsed_s: float,
        video: Operator | SteadyVideo,
        hand: str,
        episodes: EpisodesState | None = None,
        latency: Mapping[str, LatencyState | None] = MappingProxyType({}),
    ) -> SessionState:
        """All that is known without the screen, from any thread; `hand`: of `HANDS`.

        `latency`: by view, what its frames take on this side.
        """
        ages_ns = {view: video.age_ns(view, now_ns) for view in self._views}
        views = {
            view: ViewState(
                age_ms=None if age_ns is None else age_ns / NS_PER_MS, own=latency.get(view)
            )
            for view, age_ns in ages_ns.items()
        }
        tick = self._newest.of(Tick)
        return replace(
            self._maker.state(self._newest, elapsed_s, self._figures, views, hand, episodes),
            now_ns=now_ns,
            heard_ns=None if tick is None else tick.started_ns,
        )
