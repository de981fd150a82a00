"""The cases, each with its link, its disturbances and what is wanted of `feedback` in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.uplink.model import Model, Setting
from tams_app.capacity import Capacity, ConstantCapacity, RateTrace, TraceCapacity
from tams_app.config import CONFIG_DIRECTORY, Network
from tams_app.units import NS_PER_S
from tams_app.video.networks import read_trace

MODES = ("oracle", "sender", "feedback")
DELAY_TARGETS_MS = (20.0, 40.0, 80.0)
SHIPPED = ("step", "sawtooth", "markov", "outage")
LINK = Network(latency_ms=40, jitter_ms=8)
S3 = Network(latency_ms=80, jitter_ms=15, loss=0.01)


@dataclass(frozen=True, slots=True)
class Target:
    """A bound for one measure of `feedback`."""

    measure: str
    at_least: float | None = None
    at_most: float | None = None

    def met(self, value: float) -> bool:
        low = self.at_least is None or value >= self.at_least
        return low and (self.at_most is None or value <= self.at_most)

    def __str__(self) -> str:
        if self.at_least is not None:
            return f"{self.measure} ≥ {self.at_least:g}"
        return f"{self.measure} ≤ {self.at_most:g}"


@dataclass(frozen=True, slots=True)
class Case:
    """One link and one course of events."""

    name: str
    capacity: Capacity
    setting: Setting
    targets: tuple[Target, ...] = ()
    change_s: float | None = None  # when the capacity changes, where that is measured


def cases() -> Iterator[Case]:
    """All cases but those of traces given by their path."""
    for kbps in (3000, 6000, 12_000):
        steady = ConstantCapacity(kbps)
        name = f"steady {kbps // 1000} Mbit/s"
        start = Target("start_ms", at_most=1000)
        yield Case(name, steady, Setting(LINK),
                   (_used(0.90), Target("queue_p95_ms", at_most=20), start), 0.0)  # fmt: skip
        lossy = replace(Setting(LINK), network=_with(loss=0.003))
        yield Case(f"{name}, .3 % loss", steady, lossy, (_used(0.85),))
        lossy = replace(Setting(LINK), network=_with(loss=0.01))
        yield Case(f"{name}, 1 % loss", steady, lossy, (_used(0.85),))
    down = Target("below_ms", at_most=250), Target("drained_ms", at_most=700)
    rates = _rates((0, 12_000), (20, 3000), period=40)
    yield Case("step down 12 → 3", rates, Setting(LINK, 40), down, 20.0)
    up = Target("risen_ms", at_most=2000)
    rates = _rates((0, 3000), (20, 12_000), period=40)
    yield Case("step up 3 → 12", rates, Setting(LINK, 40), (up,), 20.0)
    six = ConstantCapacity(6000)
    bursts = _with(loss=0.01, loss_burst=5)
    yield Case("Gilbert-Elliott, 1 %, bursts of 5", six, Setting(bursts), (_used(0.85),))
    for outage_s in (0.3, 1.0, 3.0):
        rates = _rates((0, 6000), (20, 0), (20 + outage_s, 6000), period=40)
        back = Target("risen_ms", at_most=1000)
        yield Case(f"outage of {outage_s:g} s", rates, Setting(LINK, 40), (back,), 20 + outage_s)
    yield Case("constant flow of 2 Mbit/s", six, Setting(LINK, constant_kbps=(20, 40, 2000)))
    yield Case("TCP-like flow", six, Setting(LINK, tcp=(20, 40)))
    for kbps in (3000, 6000, 12_000):
        wild = Setting(Network(latency_ms=80, jitter_ms=30))
        yield Case(f"jitter 30 ms, {kbps // 1000} Mbit/s", ConstantCapacity(kbps), wild)
    yield Case("network s3", ConstantCapacity(3000), Setting(S3), (_used(0.85),))
    yield Case("clock 100 ppm fast", six, Setting(LINK, drift=1e-4), (_used(0.90),))
    yield Case("clock 100 ppm slow", six, Setting(LINK, drift=-1e-4), (_used(0.90),))
    yield Case("route 40 ms longer", six, Setting(LINK, route_change=(20, 40)), (_used(0.85),))
    yield Case("5 % of feedback lost", six, Setting(LINK, feedback_loss=0.05), (_used(0.85),))
    yield Case("views at 30 % for 20 s", six, Setting(LINK, limited=(20, 40, 0.3)))
    yield Case("encoders 3 % above", six, Setting(LINK, bias=1.03), (_used(0.90),))
    yield Case("encoders 3 % below", six, Setting(LINK, bias=0.97), (_used(0.85),))
    for name in SHIPPED:
        yield trace_case(CONFIG_DIRECTORY / "traces" / f"{name}.csv", 60)


def trace_case(path: Path, seconds: float, network: Network = LINK) -> Case:
    """The trace in a file, from its beginning."""
    capacity = TraceCapacity(read_trace(path), Model.START_NS)
    return Case(f"trace {path.stem}", capacity, Setting(network, seconds))


def _used(at_least: float) -> Target:
    return Target("utilisation", at_least=at_least)


def _with(**changes: float) -> Network:
    return LINK.model_copy(update=changes)


def _rates(*rows: tuple[float, float], period: float) -> Capacity:
    starts_ns = tuple(round(t_s * NS_PER_S) for t_s, _ in rows)
    rates = RateTrace(starts_ns, tuple(kbps for _, kbps in rows), round(period * NS_PER_S))
    return TraceCapacity(rates, Model.START_NS)
