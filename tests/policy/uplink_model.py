"""A fluid uplink for the budgets' laws: a bottleneck, delay, and feedback at every policy step."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random

from tams_app.records import PacketArrival, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

STEP_NS = 50 * NS_PER_MS
PACKET_BYTES = 1200
SAFETY = 0.92


@dataclass
class Uplink:
    """Views that send what they may, evenly, and a link that delivers it in order.

    frame_steps: what they make in so many steps leaves at once, as frames do that are rare.
    """

    kbps: Callable[[float], float]  # by time [s]
    delay_ms: Callable[[float], float] = lambda _t: 40.0
    share: Callable[[float], float] = lambda _t: 1.0  # sent / allowed
    lost: Callable[[Random], bool] = lambda _random: False
    jitter_ms: float = 0.0
    frame_steps: int = 0
    clock_offset_ns: int = 0
    clock_drift: float = 0.0
    clock_jump_ns: Callable[[float], int] = lambda _t: 0
    queue_ms: float = 150.0
    reports: Callable[[UplinkReport], list[UplinkReport]] = lambda report: [report]
    random: Random = field(default_factory=lambda: Random(1))

    def run(self, budget, seconds: float) -> Iterator[tuple[float, float]]:
        """Time [s] and estimate [kbit/s] after each step of 50 ms."""
        free_ns, delivered_ns, sent_bytes, spare = 0, 0, 0, 0.0
        under_way: list[tuple[int, PacketArrival]] = []  # when the sender hears of it
        dropped: list[PacketArrival] = []  # told of with the next packet that gets through
        for step in range(round(seconds * NS_PER_S / STEP_NS)):
            now_ns = NS_PER_S + step * STEP_NS
            t_s = step * STEP_NS / NS_PER_S
            told = tuple(packet for heard_ns, packet in under_way if heard_ns <= now_ns)
            under_way = [one for one in under_way if one[0] > now_ns]
            for report in self.reports(UplinkReport(now_ns, sent_bytes, told)):
                budget.observe(report)
            kbps = budget.capacity_kbps(now_ns)
            yield t_s, kbps
            media = kbps * SAFETY * self.share(t_s) * STEP_NS / 8e6
            spare += media + budget.padding_bytes(now_ns)
            waits = self.frame_steps and step % self.frame_steps
            count = 0 if waits else int(spare // PACKET_BYTES)
            spare -= count * PACKET_BYTES
            for index in range(count):
                evenly_ns = (index + 1) * STEP_NS // (count + 1)
                entered_ns = now_ns + (0 if self.frame_steps else evenly_ns)
                sent_bytes += PACKET_BYTES
                rate = self.kbps((entered_ns - NS_PER_S) / NS_PER_S)
                begin_ns = max(entered_ns, free_ns)
                if not rate or begin_ns - entered_ns > self.queue_ms * NS_PER_MS:
                    dropped.append(PacketArrival("eih", entered_ns, PACKET_BYTES, None))
                    continue
                free_ns = begin_ns + round(PACKET_BYTES * 8e6 / rate)
                jitter_ms = self.random.uniform(-self.jitter_ms, self.jitter_ms)
                one_way_ns = round((self.delay_ms(t_s) + jitter_ms) * NS_PER_MS)
                delivered_ns = max(delivered_ns, free_ns + one_way_ns)
                by_clock_ns = round(delivered_ns * (1 + self.clock_drift)) // 250_000 * 250_000
                offset_ns = self.clock_offset_ns + self.clock_jump_ns(t_s)
                arrived_ns = None if self.lost(self.random) else by_clock_ns + offset_ns
                packet = PacketArrival("eih", entered_ns, PACKET_BYTES, arrived_ns)
                heard_ns = delivered_ns + 60 * NS_PER_MS
                under_way += [(heard_ns, one) for one in (*dropped, packet)]
                dropped.clear()
