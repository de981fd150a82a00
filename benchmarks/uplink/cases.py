"""The cases, each with its link, its disturbances and what is wanted of `feedback` in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.trace_models import generate
from benchmarks.uplink.model import Setting
from tams_app.capacity import Capacity, TraceCapacity
from tams_app.config import CONFIG_DIRECTORY, Network
from tams_app.video.live.networks import CSV_HEADER, parse_trace, read_trace

MODES = ("oracle", "sender", "feedback")
DELAY_TARGETS_MS = (20.0, 40.0, 80.0)
MODELLED_STRATEGY = "equal"
SHIPPED = ("step", "sawtooth", "markov", "outage", "lte", "still")
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
    rates: str  # the text of a capacity trace
    setting: Setting
    targets: tuple[Target, ...] = ()
    change_s: float | None = None  # when the capacity changes, where that is measured
    compared: bool = False  # over the encoders with every budget and repair, else with `feedback`

    @property
    def encoders_can(self) -> bool:
        """Whether it has nothing that only the packet-level model can do."""
        setting = self.setting
        return setting == Setting(setting.network, setting.seconds, strategy=setting.strategy)

    def capacity(self, start_ns: int) -> Capacity:
        """What the bottleneck carries from `start_ns` on."""
        return TraceCapacity(parse_trace(self.rates, self.name), start_ns)


def cases() -> Iterator[Case]:
    """All cases but those of traces given by their path."""
    for kbps in (3000, 6000, 12_000):
        steady = _rates((0, kbps))
        name = f"steady {kbps // 1000} Mbit/s"
        start = Target("start_ms", at_most=1000)
        yield Case(name, steady, Setting(LINK),
                   (_used(0.90), Target("queue_p95_ms", at_most=20), start), 0.0,
                   compared=kbps == 6000)  # fmt: skip
        lossy = Setting(_with(loss=0.003))
        yield Case(f"{name}, .3 % loss", steady, lossy, (_used(0.85),))
        lossy = Setting(_with(loss=0.01))
        yield Case(f"{name}, 1 % loss", steady, lossy, (_used(0.85),))
    down = Target("below_ms", at_most=250), Target("drained_ms", at_most=700)
    rates = _rates((0, 12_000), (10, 3000), (30, 3000))
    yield Case("step down 12 → 3", rates, Setting(LINK, 25), down, 10.0, compared=True)
    up = Target("risen_ms", at_most=2000)
    rates = _rates((0, 3000), (10, 12_000), (30, 12_000))
    yield Case("step up 3 → 12", rates, Setting(LINK, 25), (up,), 10.0)
    six = _rates((0, 6000))
    bursts = _with(loss=0.01, loss_burst=5)
    yield Case("Gilbert-Elliott, 1 %, bursts of 5", six, Setting(bursts), (_used(0.85),))
    for outage_s in (0.3, 1.0, 3.0):
        rates = _rates((0, 6000), (10, 0), (10 + outage_s, 6000), (30, 6000))
        back = Target("risen_ms", at_most=1000)
        yield Case(f"outage of {outage_s:g} s", rates, Setting(LINK, 25), (back,), 10 + outage_s,
                   compared=outage_s == 1.0)  # fmt: skip
    yield Case("constant flow of 2 Mbit/s", six, Setting(LINK, constant_kbps=(20, 40, 2000)))
    yield Case("TCP-like flow", six, Setting(LINK, tcp=(20, 40)))
    for kbps in (3000, 6000, 12_000):
        wild = Setting(Network(latency_ms=80, jitter_ms=30))
        yield Case(f"jitter 30 ms, {kbps // 1000} Mbit/s", _rates((0, kbps)), wild)
    yield Case("network s3", _rates((0, 3000)), Setting(S3), (_used(0.85),), compared=True)
    lossless = Setting(S3.model_copy(update={"loss": 0.0}))
    yield Case("network s3 without loss", _rates((0, 3000)), lossless)
    yield Case("clock 100 ppm fast", six, Setting(LINK, drift=1e-4), (_used(0.90),))
    yield Case("clock 100 ppm slow", six, Setting(LINK, drift=-1e-4), (_used(0.90),))
    yield Case("route 40 ms longer", six, Setting(LINK, route_change=(20, 40)), (_used(0.85),))
    yield Case("5 % of feedback lost", six, Setting(LINK, feedback_loss=0.05), (_used(0.85),))
    yield Case("views at 30 % for 20 s", six, Setting(LINK, limited=(20, 40, 0.3)))
    yield Case("encoders 3 % above", six, Setting(LINK, bias=1.03), (_used(0.90),))
    yield Case("encoders 3 % below", six, Setting(LINK, bias=0.97), (_used(0.85),))
    for name in SHIPPED:
        shipped = trace_case(CONFIG_DIRECTORY / "traces" / f"{name}.csv", 60)
        yield replace(shipped, compared=name == "markov")


def field_cases() -> Iterator[Case]:
    """Links as they are in the field: jitter, far, very narrow, cellular, shared with others."""
    clear = _used(0.90), Target("queue_p95_ms", at_most=20)
    for kbps in (1000, 3000, 6000, 12_000):
        for loss in (0.0, 0.003, 0.01):
            name = f"{kbps / 1000:g} Mbit/s" + (f", {100 * loss:g} % loss" if loss else "")
            yield Case(name, _rates((0, kbps)), Setting(_with(loss=loss)), clear, 0.0)
    unsteady = _used(0.80), Target("queue_p95_ms", at_most=50)
    for kbps, latency, jitter, loss in (
        (6000, 100, 25, 0.001),
        (6000, 40, 30, 0.0),
        (6000, 200, 30, 0.001),
        (3000, 400, 50, 0.01),
    ):
        network = Network(latency_ms=latency, jitter_ms=jitter, loss=loss)
        name = f"{kbps / 1000:g} Mbit/s, {latency} ± {jitter} ms"
        yield Case(name, _rates((0, kbps)), Setting(network), unsteady, 0.0)
    narrow = _used(0.85), Target("loss_fraction", at_most=0.02), Target("queue_p95_ms", at_most=100)
    for kbps in (350, 200, 100):
        setting = Setting(LINK, strategy="tams+")
        yield Case(f"{kbps} kbit/s", _rates((0, kbps)), setting, narrow)
    cellular = _used(0.80), Target("queue_p95_ms", at_most=80)
    for seed in (1, 2, 3):
        yield Case(f"LTE driving {seed}", generate("lte", seed, 60), Setting(LINK), cellular)
    for seed in (1, 2, 3):
        yield Case(f"LTE at rest {seed}", generate("still", seed, 60), Setting(LINK), cellular)
    share = Target("share", at_least=0.4), Target("share", at_most=0.6)
    six = _rates((0, 6000))
    yield Case("Cubic beside it", six, Setting(LINK, cubic=(10, 40)), share)
    yield Case("second TAMS", six, Setting(LINK, second=(10, 60)), share)
    named = {case.name: case for case in cases()}
    yield from (named[name] for name in ("step down 12 → 3", "step up 3 → 12", "outage of 1 s"))


def trace_case(path: Path, seconds: float, network: Network = LINK) -> Case:
    """The trace in a file, from its beginning; ConfigError if it is none."""
    read_trace(path)
    return Case(f"trace {path.stem}", path.read_text("utf-8-sig"), Setting(network, seconds))


def rate_case(kbps: float, seconds: float, network: Network = LINK) -> Case:
    """A link that carries `kbps` all the time."""
    return Case(f"steady {kbps:g} kbit/s", _rates((0, kbps)), Setting(network, seconds))


def _used(at_least: float) -> Target:
    return Target("utilisation", at_least=at_least)


def _with(**changes: float) -> Network:
    return LINK.model_copy(update=changes)


def _rates(*rows: tuple[float, float]) -> str:
    """A trace's text from seconds and kbit/s; it repeats after its last row, as long as before."""
    lines = (f"{t_s * 1000:g},{kbps:g}" for t_s, kbps in rows)
    return "\n".join((CSV_HEADER, *lines, ""))
