"""How far an arm is led away by an attacker who delays and drops the operator's samples.

`python -m benchmarks.experiments.steering` swings a hand about one place, in virtual time, through
the robot's side as it is, under attacks that see the hand: they lose or delay what it does on its
way back. It prints what was led away beside a swing of which everything arrives, where the arm did
not hold; then how often honest networks make a lively hand's arm hold.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from random import Random

import numpy as np
from rich.console import Console

from tams_app.config import LinkConfig, load_config
from tams_app.records import ControllerStatus
from tams_app.session.robot import for_robot
from tams_app.teleop.motion import HandMotion
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import loss_model
from tests.hw.link.exchange import TICK_NS, Exchange
from tests.teleop.rig import Bench, hand_for

DELAY_NS = 20 * NS_PER_MS
SECONDS = 4.0
FREQUENCIES_HZ = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
SPEEDS_M_S = (0.1, 0.25)
Fate = Callable[[float, int], int | None]  # phase 0..1 of the swing, time [ns]: delay [ns] or lost
HAND_HZ, HAND_M = (0.35, 0.8, 1.7), (0.05, 0.03, 0.008)  # of the lively hand, on each axis
# latency and jitter [ms], loss, mean burst [packets]
NETWORKS = {
    "s1": (15.0, 2.0, 0.0001, 1.0),
    "s2": (40.0, 8.0, 0.003, 1.0),
    "s3": (80.0, 15.0, 0.01, 1.0),
    "20 ms, 1 %": (20.0, 5.0, 0.01, 1.0),
    "20 ms, 1 %, bursts of 4": (20.0, 5.0, 0.01, 4.0),
    "s3, bursts of 4": (80.0, 15.0, 0.01, 4.0),
    "20 ms, 3 %, bursts of 4": (20.0, 5.0, 0.03, 4.0),
}


@dataclass(frozen=True, slots=True)
class Swing:
    """frequency [Hz], peak speed [m/s]; abrupt: it turns round within a sixth of a half swing."""

    frequency_hz: float
    peak_m_s: float
    abrupt: bool

    def speed_m_s(self, phase: float) -> float:
        wave = math.cos(math.tau * phase)
        return self.peak_m_s * (max(-1.0, min(1.0, 6.0 * wave)) if self.abrupt else wave)


def gaps(gap_ms: float, most_per_s: float = math.inf) -> Fate:
    """On the way back one message passes in each `gap_ms`, in so many gaps a second at most."""
    passed_ns, begun_ns = 0, []

    def fate(phase: float, now_ns: int) -> int | None:
        nonlocal passed_ns, begun_ns
        begun_ns = [t_ns for t_ns in begun_ns if now_ns - t_ns < 1.05 * NS_PER_S]
        begins = passed_ns == now_ns - TICK_NS
        may = not begins or len(begun_ns) < most_per_s
        if _back(phase) and now_ns - passed_ns < gap_ms * NS_PER_MS and may:
            begun_ns += [now_ns] * begins
            return None
        passed_ns = now_ns
        return DELAY_NS

    return fate


def late(by_ms: float) -> Fate:
    """What the hand does on its way back comes later."""
    return lambda phase, _: DELAY_NS + round(by_ms * NS_PER_MS) * _back(phase)


def stretched(by_ms: float) -> Fate:
    """The way grows longer while the hand goes, and shorter while it comes back."""
    more_ns = 0.0

    def fate(phase: float, _: int) -> int:
        nonlocal more_ns
        change_ns = 0.8 * TICK_NS * (-1 if _back(phase) else 1)
        more_ns = min(by_ms * NS_PER_MS, max(0.0, more_ns + change_ns))
        return DELAY_NS + round(more_ns)

    return fate


def hidden(
    for_ms: float, frequency_hz: float, from_phase: float = 0.25, early_ms: float = 0
) -> Fate:
    """What comes after a phase of each swing is lost for so long; at .25 the hand turns back.

    `early_ms`: but for one message after so much of that time, which comes without any delay, as a
    copy by a faster way; 0: none.
    """

    def fate(phase: float, _: int) -> int | None:
        into_ms = 1000.0 * ((phase - from_phase) % 1.0) / frequency_hz
        if into_ms >= for_ms:
            return DELAY_NS
        return 0 if early_ms and 0.0 <= into_ms - early_ms < TICK_NS / NS_PER_MS else None

    return fate


def attacks(frequency_hz: float) -> Iterator[tuple[str, Fate]]:
    """Each kind with several lengths [ms]."""
    for ms in (25, 33, 42, 50, 58, 75, 90):
        yield f"gaps of {ms} ms", gaps(ms)
    for ms in (75, 95):
        yield f"two gaps of {ms} ms a second", gaps(ms, 2)
    for ms in (20, 40, 55):
        yield f"{ms} ms late on the way back", late(ms)
    for ms in (20, 45):
        yield f"stretched by {ms} ms", stretched(ms)
    for ms in (25, 33, 45, 50, 90):
        yield f"{ms} ms of the turn hidden", hidden(ms, frequency_hz)
    for phase, ms in product((0.3, 0.4, 0.5), (75, 91)):
        yield f"{ms} ms from phase {phase} hidden", hidden(ms, frequency_hz, phase)
    for phase, ms in product((0.25, 0.3, 0.4, 0.5), (91, 116, 140)):
        fate = hidden(ms, frequency_hz, phase, early_ms=75)
        yield f"{ms} ms from phase {phase} hidden but for one early message", fate


def _back(phase: float) -> bool:
    return 0.25 <= phase < 0.75


def travel_mm(swing: Swing, fate: Fate) -> float | None:
    """Where the arm is after `SECONDS`; None if it held."""
    bench = Bench(for_robot(load_config()))
    exchange = Exchange(bench.config.link, now_ns=bench.now_ns).settled()
    bench.now_ns = exchange.now_ns
    bench.tick(sample=exchange.tick())
    bench.arm_ready = True
    bench.tick(sample=exchange.tick(), confirm=True)
    exchange.hand.trigger = 1.0
    for _ in range(30):
        bench.tick(sample=exchange.tick())
    start_ns, start_mm = exchange.now_ns, 1000.0 * bench.arm.pose.position[1]
    for _ in range(round(SECONDS * NS_PER_S / TICK_NS)):
        since_s = (exchange.now_ns - start_ns) / NS_PER_S
        phase = since_s * swing.frequency_hz % 1.0
        velocity = hand_for((0.0, swing.speed_m_s(phase), 0.0), bench.config)
        exchange.hand.velocity = velocity

        def up(now_ns: int, phase: float = phase) -> int | None:
            return fate(phase, now_ns)

        exchange.up = up
        if bench.tick(sample=exchange.tick()).arming is not ArmingState.ENGAGED:
            return None
    return float(1000.0 * bench.arm.pose.position[1] - start_mm)


def search(console: Console) -> None:
    """The worst of each kind of swing that ended without a hold."""
    most = load_config().limits.motion.acceleration_m_s2
    worst: dict[bool, list[tuple[float, str]]] = {True: [], False: []}
    for frequency_hz, peak_m_s, abrupt in product(FREQUENCIES_HZ, SPEEDS_M_S, (False, True)):
        swing = Swing(frequency_hz, peak_m_s, abrupt)
        plain_mm = travel_mm(swing, lambda _phase, _now_ns: DELAY_NS) or 0.0
        turns_m_s2 = peak_m_s * math.tau * frequency_hz * (6.0 if abrupt else 1.0)
        for name, fate in attacks(frequency_hz):
            led_mm = travel_mm(swing, fate)
            if led_mm is not None:
                drift_mm_s = abs(led_mm - plain_mm) / SECONDS
                worst[turns_m_s2 <= most].append((drift_mm_s, f"{name}, {swing}"))
    for follows, found in worst.items():
        console.print("the arm can follow:" if follows else "the arm cannot follow:")
        for drift_mm_s, what in sorted(found, reverse=True)[:5]:
            console.print(f"  {drift_mm_s:.1f} mm/s  {what}", highlight=False, soft_wrap=True)


def holds_per_minute(
    network: tuple[float, float, float, float], minutes: float
) -> dict[str, float]:
    """How often a lively hand's arm would hold or lose the link."""
    latency_ms, jitter_ms, loss, burst = network
    draw, lost = Random(1), loss_model(loss, burst, Random(2)).lost
    link = LinkConfig(latency_ms=latency_ms, jitter_ms=jitter_ms)
    exchange = Exchange(link, delay_ms=latency_ms).settled()
    config, arrives_ns = load_config(), [0, 0]

    def way(direction: int, now_ns: int) -> int:
        delay_ms = latency_ms + jitter_ms * draw.uniform(-1.0, 1.0)
        arrives_ns[direction] = max(arrives_ns[direction], now_ns + round(delay_ms * NS_PER_MS))
        return arrives_ns[direction] - now_ns

    exchange.down = lambda now_ns: way(1, now_ns)

    def up(now_ns: int) -> int | None:
        delay_ns = way(0, now_ns)
        return None if lost() else delay_ns

    exchange.up = up
    fastest = (config.limits.max_speed_mm_s / 1000.0, config.limits.max_rotation_rad_s)
    motion, counts = HandMotion(config.hand, link.bridge_ms * NS_PER_MS, fastest), Counter[str]()
    phases = np.array([[draw.uniform(0.0, math.tau) for _ in HAND_HZ] for _ in range(3)])
    rates, amplitudes = math.tau * np.array(HAND_HZ), np.array(HAND_M)
    engaged, before = False, ControllerStatus.OK
    for tick in range(round(minutes * 60 * NS_PER_S / TICK_NS)):
        since_s = tick * TICK_NS / NS_PER_S
        exchange.hand.velocity = (amplitudes * rates * np.cos(rates * since_s + phases)).sum(axis=1)
        sample = exchange.tick()
        exchange.forget()
        if sample.status is not ControllerStatus.OK:
            counts[sample.status.value] += sample.status is not before
            engaged = False
        elif not engaged:
            motion.anchor(sample)
            engaged = True
        else:
            motion.update(sample, exchange.now_ns, TICK_NS / NS_PER_S)
            if motion.is_adrift(turning=False):
                counts["hand not followed"] += 1
                engaged = False
        before = sample.status
    return {what: round(count / minutes, 2) for what, count in counts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="of each honest network")
    minutes, console = parser.parse_args().minutes, Console()
    search(console)
    for name, network in NETWORKS.items():
        found = holds_per_minute(network, minutes)
        console.print(f"{name}: {found or 'none'} a minute", highlight=False)


if __name__ == "__main__":
    main()
