"""The state of a running session, as the robot's side knows it, with the uplink's load."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping, Sequence
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
from tams_app.state import StateMaker
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.uplink_figures import ReportedPackets, UplinkFigures, uplink_figures

WINDOW_NS = NS_PER_S
_OLD_NS = 2 * NS_PER_S  # what is known of so long ago says nothing of now


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


class UplinkMeter:
    """The uplink's load in the last second; each method from any thread.

    An emulated network knows each packet's fate (`packets`), and then nothing else counts. Of a
    real one there is only what receivers report (`reported`), half a round trip later.
    """

    def __init__(self, views: tuple[str, ...]) -> None:
        self._views = views
        self._lock = threading.Lock()
        self._packets: deque[PacketRecord] = deque()
        self._emulated = False

    @property
    def emulated(self) -> bool:
        """Whether the network is emulated: what receivers report does not count then."""
        return self._emulated

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Newly decided packet fates; those older than the window are forgotten."""
        with self._lock:
            if not self._emulated:
                self._emulated = True
                self._packets.clear()
            self._add(packets)

    def report(self, packets: Sequence[PacketRecord]) -> None:
        """Count the packets that receivers have reported."""
        with self._lock:
            if not self._emulated:
                self._add(packets)

    def figures(self, now_ns: int) -> UplinkFigures:
        """As far as they are known."""
        with self._lock:
            packets = list(self._packets)
        if packets and now_ns - packets[-1].entered_ns > _OLD_NS:
            packets = []
        return uplink_figures(packets, self._views, WINDOW_NS)

    def _add(self, packets: Sequence[PacketRecord]) -> None:
        self._packets.extend(packets)
        oldest_ns = self._packets[-1].entered_ns - WINDOW_NS if self._packets else 0
        while self._packets and self._packets[0].entered_ns < oldest_ns:
            self._packets.popleft()
