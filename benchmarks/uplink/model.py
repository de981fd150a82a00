"""A session's traffic, packet by packet, without encoders: views, padding, feedback, other flows.

The link is the product's (`tams_app.video.core.link`), the budget and the pacer too. What encoders
do is drawn: the size of a frame is its target's share times a constant bias and a random factor; a
keyframe is larger, and the frames after it give back what it took, as the servo makes them. A frame
enters the link as the pacer lets it, in one burst where the budget asks for no feedback of packets.
The receiver tells of all packets every 25 to 50 ms, and what it tells comes back with the link's
delay; packets of the policy's padding are fed back as any other. What is under way is bounded as in
the product (`tams_app.video.core.pacer`), and so are the frames of a view whose target would
starve them.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from random import Random

from tams_app.capacity import Capacity
from tams_app.config import Network, PolicyConfig
from tams_app.policy.allocation import STRATEGIES, Policy
from tams_app.policy.budget import BUDGETS, Budget
from tams_app.policy.budget.sender import START_KBPS
from tams_app.records import (
    PacketArrival,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    Reception,
    UplinkReport,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import Link
from tams_app.video.core.pacer import FlightBound, Pacer
from tams_app.video.core.rate_control import SourceDrop

VIEWS = ("eih", "gt", "gs")
PADDING = "padding"
PACKET_BYTES = 1240  # 1200 of RTP payload and its headers
TICK_NS = NS_PER_S // 20  # the policy loop's
PADDING_NS = 10 * NS_PER_MS  # the budget is asked for padding this often, as a pacer asks
ARRIVAL_STEP_NS = 250_000  # the resolution of transport-wide feedback
KEYFRAME_FACTOR = 1.5
REPAID_OVER_FRAMES = 8
RECEPTION_NS = NS_PER_S  # between two receiver reports


@dataclass(frozen=True, slots=True)
class Setting:
    """What a run is made of, besides capacity and budget."""

    network: Network
    seconds: float = 60.0
    seed: int = 1
    bias: float = 1.0  # sent / target
    noise: float = 0.1  # standard deviation of a frame's size
    keyframe_s: float = 10.0  # between two of one view
    drift: float = 0.0  # of the receiver's clock
    route_change: tuple[float, float] | None = None  # at [s], longer by [ms]
    feedback_loss: float = 0.0
    limited: tuple[float, float, float] | None = None  # from, to [s]: views make this share
    constant_kbps: tuple[float, float, float] | None = None  # from, to [s], rate of another flow
    tcp: tuple[float, float] | None = None  # from, to [s]: a flow that fills the queue
    cubic: tuple[float, float] | None = None  # the same with Cubic's window
    second: tuple[float, float] | None = None  # from, to [s]: another sender with the same budget
    strategy: str = "equal"
    fps: int = 30


@dataclass(slots=True)
class Trace:
    """What happened: all packets at the link, and what was allowed."""

    packets: list[PacketRecord] = field(default_factory=list)  # ours, in the order of entering
    others: list[PacketRecord] = field(default_factory=list)
    standing_ns: list[int] = field(default_factory=list)  # what each frame found in the queue
    targets: list[tuple[int, float]] = field(default_factory=list)  # all views together [kbit/s]
    capacities: list[tuple[int, float]] = field(default_factory=list)  # estimates
    kept: dict[str, list[int]] = field(default_factory=lambda: {view: [] for view in VIEWS})
    padding_bytes: int = 0
    frames: int = 0
    skipped: int = 0


class _Events:
    """What is to happen, in the order of time."""

    def __init__(self) -> None:
        self._events: list[tuple[int, int, Callable[[int], None]]] = []
        self._count = 0

    def at(self, time_ns: int, action: Callable[[int], None]) -> None:
        self._count += 1
        heapq.heappush(self._events, (time_ns, self._count, action))

    def run(self, end_ns: int) -> None:
        while self._events and self._events[0][0] < end_ns:
            now_ns, _, action = heapq.heappop(self._events)
            action(now_ns)


class Model:
    """One run; `START_NS` is the first instant, at which a trace begins."""

    START_NS = 100 * NS_PER_S

    def __init__(
        self,
        setting: Setting,
        capacity: Capacity,
        make_budget: Callable[[], Budget],
        policy: PolicyConfig,
    ) -> None:
        names = (*VIEWS, PADDING, "constant", "tcp")
        names += tuple(f"{name}.2" for name in names) if setting.second else ()
        link = Link(setting.network, capacity, names, setting.seed)
        self._setting = setting
        self._events = _Events()
        self._link = link
        self._sender = _Sender(setting, link, self._events, make_budget(), policy, "", Trace())
        self.trace = self._sender.trace
        self._second = make_budget() if setting.second else None
        self._policy = policy

    def run(self) -> Trace:
        setting, events, others = self._setting, self._events, self.trace.others
        start_ns = self.START_NS
        end_ns = start_ns + round(setting.seconds * NS_PER_S)
        self._sender.start(start_ns, end_ns)
        if setting.constant_kbps is not None:
            events.at(start_ns + round(setting.constant_kbps[0] * NS_PER_S), self._constant)
        for span, flow in ((setting.tcp, TcpFlow), (setting.cubic, CubicFlow)):
            if span is not None:
                tcp = flow(self._link, events.at, others, start_ns + round(span[1] * NS_PER_S))
                events.at(start_ns + round(span[0] * NS_PER_S), tcp.start)
        if setting.second is not None and self._second is not None:
            from_ns, to_ns = (start_ns + round(s * NS_PER_S) for s in setting.second)
            trace = Trace(packets=others, others=self.trace.packets)
            second = _Sender(setting, self._link, events, self._second, self._policy, ".2", trace)
            events.at(from_ns, lambda now_ns: second.start(now_ns, to_ns))
        events.run(end_ns)
        return self.trace

    def _constant(self, now_ns: int) -> None:
        """A packet of the flow of a constant rate."""
        assert self._setting.constant_kbps is not None
        _, end_s, kbps = self._setting.constant_kbps
        if now_ns - self.START_NS < end_s * NS_PER_S:
            record = self._link.offer(now_ns, "constant", PacketKind.MEDIA, PACKET_BYTES, 0)
            self.trace.others.append(record)
            self._events.at(now_ns + round(PACKET_BYTES * 8 / kbps * NS_PER_MS), self._constant)


class _Sender:
    """The views of one robot, and their receiver."""

    def __init__(
        self,
        setting: Setting,
        link: Link,
        events: _Events,
        budget: Budget,
        policy: PolicyConfig,
        name: str,
        trace: Trace,
    ) -> None:
        """`name` ends those of its streams at the link."""
        self._setting = setting
        self._link = link
        self._at = events.at
        self._budget = budget
        self._name = name
        self._policy = Policy(STRATEGIES[setting.strategy](policy), budget, policy)
        self._random = Random(f"{setting.seed}/sources{name}")
        self._receiver = Random(f"{setting.seed}/receiver{name}")
        self._flight = FlightBound(VIEWS)
        kind = BUDGETS[policy.budget.mode]
        self._pacer = Pacer(START_KBPS) if kind.receives_packets else None
        self._drop = {
            view: SourceDrop(self._policy.strategy.source_drop_below_kbps) for view in VIEWS
        }
        self._start_ns = self._end_ns = 0
        self._targets: dict[str, float] = dict.fromkeys(VIEWS, 0.0)
        self._owed = dict.fromkeys(VIEWS, 0.0)  # what keyframes took in advance [bytes]
        self._keyframe_ns = dict.fromkeys(VIEWS, 0)
        self._sent_bytes = 0
        self._reported_ns = 0  # when the newest packet left that was reported
        self._underway: list[PacketRecord] = []  # not told of by the receiver
        self._arrivals: list[PacketArrival] = []  # back at the sender
        self._receptions: list[Reception] = []
        self._received = (0, 0)  # packets arrived and lost since the last receiver report
        self.trace = trace

    def start(self, now_ns: int, end_ns: int) -> None:
        """Send from now until `end_ns`."""
        self._start_ns, self._end_ns = now_ns, end_ns
        period_ns = NS_PER_S // self._setting.fps
        self._at(now_ns, self._tick)
        for index, view in enumerate(VIEWS):
            self._keyframe_ns[view] = now_ns + (index + 1) * NS_PER_S
            self._at(now_ns + index * period_ns // len(VIEWS), self._frames_of(view))
        self._at(now_ns, self._pad)
        self._at(now_ns + 30 * NS_PER_MS, self._feed_back)
        self._at(now_ns + RECEPTION_NS, self._report)

    def _seconds(self, now_ns: int) -> float:
        return (now_ns - Model.START_NS) / NS_PER_S

    # --- the sender -------------------------------------------------------------------------------

    def _tick(self, now_ns: int) -> None:
        report = UplinkReport(
            now_ns, self._sent_bytes, tuple(self._arrivals), tuple(self._receptions)
        )
        self._arrivals, self._receptions = [], []
        allocation = self._policy.step(Phase.REACH, report)
        self._targets = dict(allocation.target_kbps)
        self._flight.set(self._policy.budget.flight_limit_bytes(now_ns), allocation.target_kbps)
        if self._pacer is not None:
            self._pacer.set(allocation.capacity_kbps)
        self.trace.targets.append((now_ns, sum(self._targets.values())))
        self.trace.capacities.append((now_ns, allocation.capacity_kbps))
        self._at(now_ns + TICK_NS, self._tick)

    def _pad(self, now_ns: int) -> None:
        if now_ns >= self._end_ns:
            return
        padding = self._budget.padding_bytes(now_ns)
        self.trace.padding_bytes += padding
        self._enter(now_ns, PADDING, padding)
        self._at(now_ns + PADDING_NS, self._pad)

    def _frames_of(self, view: str) -> Callable[[int], None]:
        def frame(now_ns: int) -> None:
            if now_ns >= self._end_ns:
                return
            self._at(now_ns + NS_PER_S // self._setting.fps, frame)
            self.trace.frames += 1
            waiting_bytes = 0.0 if self._pacer is None else self._pacer.waiting_bytes(now_ns)
            if self._flight.exceeded(
                view, now_ns, self._sent_bytes, self._reported_ns, waiting_bytes
            ):
                self.trace.skipped += 1
            elif self._drop[view].keep(self._targets[view], NS_PER_S // self._setting.fps):
                self.trace.kept[view].append(now_ns)
                self._send(now_ns, view, max(1, round(self._frame_bytes(now_ns, view))))

        return frame

    def _frame_bytes(self, now_ns: int, view: str) -> float:
        setting = self._setting
        period_ns = NS_PER_S // setting.fps
        kbps = self._drop[view].frame_target_kbps(self._targets[view], period_ns)
        mean = kbps * setting.bias * 1000 / 8 / setting.fps
        if setting.limited and setting.limited[0] <= self._seconds(now_ns) < setting.limited[1]:
            mean *= setting.limited[2]
        size = max(0.2, self._random.gauss(1.0, setting.noise)) * mean
        repaid = min(self._owed[view] / REPAID_OVER_FRAMES, 0.5 * size)
        if now_ns >= self._keyframe_ns[view]:
            self._keyframe_ns[view] += round(setting.keyframe_s * NS_PER_S)
            self._owed[view] += (KEYFRAME_FACTOR - 1) * mean
            return KEYFRAME_FACTOR * mean
        self._owed[view] -= repaid
        return size - repaid

    def _send(self, now_ns: int, view: str, size_bytes: int) -> None:
        before = (*self.trace.packets[-1:], *self.trace.others[-1:])
        free_ns = max((record.departed_ns for record in before), default=0)
        self.trace.standing_ns.append(max(0, free_ns - now_ns))
        if self._pacer is None:
            self._enter(now_ns, view, size_bytes)
            return
        sizes = _packets(size_bytes)
        for part in self._pacer.parts(sizes):
            part_bytes = sum(sizes[part])
            leaves_ns = self._pacer.reserve(now_ns, part_bytes)
            self._at(leaves_ns, partial(self._enter, view=view, size_bytes=part_bytes))

    def _enter(self, now_ns: int, view: str, size_bytes: int) -> None:
        for packet in _packets(size_bytes):
            record = self._link.offer(now_ns, view + self._name, PacketKind.MEDIA, packet, 0)
            self._sent_bytes += packet
            self.trace.packets.append(record)
            self._underway.append(record)

    # --- the receiver -----------------------------------------------------------------------------

    def _feed_back(self, now_ns: int) -> None:
        """Tell of all that has arrived, and of what is missing before the newest of it."""
        self._at(now_ns + round(self._receiver.uniform(25, 50) * NS_PER_MS), self._feed_back)
        newest = max(
            (i for i, record in enumerate(self._underway) if 0 < record.delivered_ns <= now_ns),
            default=-1,
        )
        told, self._underway = self._underway[: newest + 1], self._underway[newest + 1 :]
        if not told:
            return
        arrivals = [self._arrival(record) for record in told]
        lost = sum(arrival.arrived_ns is None for arrival in arrivals)
        self._received = self._received[0] + len(arrivals) - lost, self._received[1] + lost
        back_ns = self._link.feedback(now_ns, VIEWS[0])
        dropped = self._receiver.random() < self._setting.feedback_loss

        def arrive(_now_ns: int) -> None:
            if not dropped:
                self._arrivals += arrivals
                self._reported_ns = max(self._reported_ns, arrivals[-1].sent_ns)

        self._at(back_ns, arrive)

    def _arrival(self, record: PacketRecord) -> PacketArrival:
        arrived_ns = None
        if record.fate is PacketFate.DELIVERED:
            delivered_ns = record.delivered_ns
            change = self._setting.route_change
            if change is not None and self._seconds(delivered_ns) >= change[0]:
                delivered_ns += round(change[1] * NS_PER_MS)
            by_clock_ns = 7 * NS_PER_S + delivered_ns * (1 + self._setting.drift)
            arrived_ns = round(by_clock_ns / ARRIVAL_STEP_NS) * ARRIVAL_STEP_NS
        return PacketArrival(record.view, record.entered_ns, record.size_bytes, arrived_ns)

    def _report(self, now_ns: int) -> None:
        self._at(now_ns + RECEPTION_NS, self._report)
        arrived, lost = self._received
        self._received = 0, 0
        if not arrived:
            return
        newest = next(r for r in reversed(self.trace.packets) if 0 < r.delivered_ns <= now_ns)
        back_ns = self._link.feedback(now_ns, VIEWS[0])
        trip_ns = newest.delivered_ns - newest.entered_ns + back_ns - now_ns
        jitter_ns = round(self._setting.network.jitter_ms * NS_PER_MS / 2)
        reception = Reception(VIEWS[0], lost / (arrived + lost), trip_ns, jitter_ns)
        self._at(back_ns, lambda _now_ns: self._receptions.append(reception))


class TcpFlow:
    """A long transfer in the manner of Reno: a window that grows by a packet a round trip.

    It halves once a round trip when a packet is missing, which it hears with the acknowledgement
    of those behind it, and begins again with two packets after a second in which none came.
    """

    def __init__(
        self,
        link: Link,
        at: Callable[[int, Callable[[int], None]], None],
        records: list[PacketRecord],
        end_ns: int,
    ) -> None:
        self._link = link
        self._at = at
        self._records = records
        self._end_ns = end_ns
        self._window = 10.0
        self._slow_start = 64.0
        self._underway = 0
        self._heard_ns = 0
        self._cut_ns = 0

    def start(self, now_ns: int) -> None:
        self._heard_ns = self._cut_ns = now_ns
        self._fill(now_ns)
        self._at(now_ns + NS_PER_S, self._watch)

    def _fill(self, now_ns: int) -> None:
        while self._underway < int(self._window) and now_ns < self._end_ns:
            record = self._link.offer(now_ns, "tcp", PacketKind.MEDIA, 1500, 0)
            self._records.append(record)
            self._underway += 1
            if record.fate is PacketFate.DELIVERED:
                self._at(record.delivered_ns, self._received)
            else:  # three packets behind it tell of it, about a round trip later
                self._at(now_ns + 250 * NS_PER_MS, self._missing(now_ns))

    def _received(self, now_ns: int) -> None:
        self._at(self._link.feedback(now_ns, VIEWS[1]), self._acknowledged)

    def _acknowledged(self, now_ns: int) -> None:
        self._underway -= 1
        self._heard_ns = now_ns
        self._window += 1.0 if self._window < self._slow_start else self._growth(now_ns)
        self._fill(now_ns)

    def _growth(self, _now_ns: int) -> float:
        """What one acknowledgement adds to the window beyond slow start."""
        return 1.0 / self._window

    def _cut(self) -> float:
        """The window after a loss."""
        return self._window / 2

    def _missing(self, sent_ns: int) -> Callable[[int], None]:
        def missing(now_ns: int) -> None:
            self._underway -= 1
            if sent_ns > self._cut_ns:
                self._cut_ns = now_ns
                self._window = self._slow_start = max(2.0, self._cut())
            self._fill(now_ns)

        return missing

    def _watch(self, now_ns: int) -> None:
        if now_ns - self._heard_ns > NS_PER_S:
            self._window = 2.0
        self._fill(now_ns)
        if now_ns < self._end_ns:
            self._at(now_ns + NS_PER_S, self._watch)


class CubicFlow(TcpFlow):
    """The same with the window of RFC 9438: C = .4, β = .7, without fast convergence."""

    _lost_at = 0.0  # the window at the last loss

    def _cut(self) -> float:
        self._lost_at = self._window
        return 0.7 * self._window

    def _growth(self, now_ns: int) -> float:
        since_s = (now_ns - self._cut_ns) / NS_PER_S
        target = 0.4 * (since_s - math.cbrt(self._lost_at * 0.3 / 0.4)) ** 3 + self._lost_at
        grown = (min(target, 1.5 * self._window) - self._window) / self._window
        return max(grown, 0.53 / self._window)  # as Reno, where that is more


def _packets(size_bytes: int) -> list[int]:
    """The sizes of the packets that so many bytes take."""
    whole, rest = divmod(size_bytes, PACKET_BYTES)
    return [PACKET_BYTES] * whole + [rest] * (rest > 0)


def departed_bytes(records: Sequence[PacketRecord], start_ns: int, end_ns: int) -> int:
    """What left the bottleneck in that time, lost behind it or not."""
    return sum(r.size_bytes for r in records if start_ns <= r.departed_ns < end_ns)
