"""Uplink conditions by name or trace file, their bottleneck's capacity, and who emulates them.

Traces are text: `t_ms,kbps` tables or Mahimahi files, distinguished by the first line.

CSV: the header `t_ms,kbps`, or `t_s`, or `mbps`, then one row per change; times ascend and count
from the first row. Semicolons and tabs separate as commas do; beside them a comma is a decimal one.
The last rate holds as long as the one before it (a single row: for ever), then the trace repeats.

Mahimahi: one line per opportunity to send 1500 bytes, its time in whole milliseconds; a time may
repeat. The trace repeats from its last time on. The bits of an opportunity are spread over the
time since the one before, so a packet of 1500 bytes ends exactly at its opportunity.

The rates of a table are 0 or within the bounds of `capacity`; no trace is longer than a day.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from tams_app.capacity import (
    LARGEST_KBPS,
    SMALLEST_KBPS,
    Capacity,
    ConstantCapacity,
    RateTrace,
    TraceCapacity,
    UnlimitedCapacity,
)
from tams_app.config import CONFIG_DIRECTORY, Config, Network
from tams_app.errors import ConfigError, not_one_of
from tams_app.records import PacketRecord
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.reporting_helper import ReportingHelper
from tams_app.video.live.udp import ViewPorts

CSV_HEADER = "t_ms,kbps"
_COLUMNS = {"t_ms": 1.0, "t_s": 1000.0}, {"kbps": 1.0, "mbps": 1000.0}  # to [ms] and [kbit/s]
_SEPARATORS = "\t;,"
_MOST_MEAN_KBPS, _LEAST_PERIOD_S = 1e6, 1.0  # beyond these a unit is likely to be another one
_OPPORTUNITY_BITS = 1500 * 8
_LONGEST_MS = 24 * 3600 * 1000


def resolve_network(config: Config, name: str) -> Network:
    """The condition `name`, or for a trace's path one with that trace and nothing else.

    A trace is looked for from the working directory, then from `config/`, and is read once so
    that a wrong one is reported now; `trace` is absolute in the result. ConfigError lists the
    valid names.
    """
    network = config.networks.get(name)
    if network is None:
        if _find(name) is None:
            raise ConfigError(
                f"network: no such trace file, and {not_one_of(name, config.networks)}"
            )
        network = Network(trace=name)
    if network.trace is None:
        return network
    path = _find(network.trace)
    if path is None:
        raise ConfigError(f"networks.{name}.trace: there is no file {network.trace}")
    read_trace(path)
    return network.model_copy(update={"trace": str(path)})


def network_capacity(network: Network, epoch_ns: int) -> Capacity:
    """The capacity of `network`'s bottleneck; a trace begins at `epoch_ns`."""
    if network.trace is not None:
        return TraceCapacity(read_trace(Path(network.trace)), epoch_ns)
    if network.rate_kbps is not None:
        return ConstantCapacity(network.rate_kbps)
    return UnlimitedCapacity()


def read_trace(path: Path) -> RateTrace:
    """The trace in `path`; ConfigError names file, line and reason."""
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a text file, so it is no capacity trace") from error
    return parse_trace(text, str(path))


def _find(name: str) -> Path | None:
    candidates = (Path(name), CONFIG_DIRECTORY / name)
    try:
        return next((path.resolve() for path in candidates if path.is_file()), None)
    except OSError:  # too long to be a path, or below a folder that may not be read
        return None


def parse_trace(text: str, name: str) -> RateTrace:
    """The trace in `text`; ConfigError with `name`, line and reason if it is none."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line]
    if not lines:
        raise ConfigError(f"{name}: is empty: a trace holds {CSV_HEADER} rows or millisecond times")
    is_table = any(separator in lines[0][1] for separator in _SEPARATORS)
    try:
        return _parse_table(lines, name) if is_table else _parse_opportunities(lines, name)
    except ValueError as error:
        raise ConfigError(f"{name}: {error}") from error


def described(trace: RateTrace) -> tuple[str, bool]:
    """Length, mean and peak of a trace, and whether they are what a link has."""
    seconds = trace.period_ns / NS_PER_S
    mean_kbps = TraceCapacity(trace, 0).mean_kbps(0, trace.period_ns)
    text = f"{seconds:g} s, {mean_kbps:.0f} kbit/s in the mean, {max(trace.kbps):.0f} at most"
    if mean_kbps <= _MOST_MEAN_KBPS and seconds >= _LEAST_PERIOD_S:
        return text, True
    return f"{text}: are its units those of {CSV_HEADER}? (t_s and mbps are taken as well)", False


def _parse_table(lines: list[tuple[int, str]], name: str) -> RateTrace:
    number, header = lines[0]
    separator = next(one for one in _SEPARATORS if one in header)
    columns = [column.strip(" \"'").lower() for column in header.split(separator)]
    if len(columns) != 2 or any(
        one not in units for one, units in zip(columns, _COLUMNS, strict=True)
    ):
        raise _wrong(name, number, f"the header must be {CSV_HEADER} (or t_s, mbps)")
    to_ms, to_kbps = (units[one] for one, units in zip(columns, _COLUMNS, strict=True))
    read = [(number, _parse_row(name, number, line, separator)) for number, line in lines[1:]]
    rows = [(t * to_ms, _rate(name, number, rate * to_kbps)) for number, (t, rate) in read]
    if not rows:
        raise ConfigError(f"{name}: holds a header but no rows")
    starts_ns = [0]
    for (number, _), (t_ms, _) in zip(lines[2:], rows[1:], strict=True):
        since_first_ms = t_ms - rows[0][0]
        _check_length(name, number, since_first_ms)
        starts_ns.append(round(max(0.0, since_first_ms) * NS_PER_MS))
        if starts_ns[-1] <= starts_ns[-2]:
            raise _wrong(name, number, "t_ms must be greater than in the row before")
    last_ns = starts_ns[-1] - starts_ns[-2] if len(rows) > 1 else NS_PER_S
    period_ns = starts_ns[-1] + last_ns
    _check_length(name, lines[-1][0], period_ns / NS_PER_MS)
    return RateTrace(tuple(starts_ns), tuple(kbps for _, kbps in rows), period_ns)


def _parse_row(name: str, number: int, line: str, separator: str) -> tuple[float, float]:
    fields = [field.strip(" \"'") for field in line.split(separator)]
    if len(fields) != 2:
        raise _wrong(name, number, f"a row holds two numbers, {CSV_HEADER}")
    try:  # a comma that does not separate is a decimal one
        t, rate = (float(field.replace(",", ".")) for field in fields)
    except ValueError:
        raise _wrong(name, number, f"{line!r} is not two numbers") from None
    if not math.isfinite(t) or not math.isfinite(rate):
        raise _wrong(name, number, "numbers must be finite")
    return t, rate


def _rate(name: str, number: int, kbps: float) -> float:
    if kbps != 0 and not SMALLEST_KBPS <= kbps <= LARGEST_KBPS:
        bounds = f"{SMALLEST_KBPS:,.0f} to {LARGEST_KBPS:,.0f}"
        raise _wrong(name, number, f"kbps must be 0 or from {bounds}")
    return kbps


def _parse_opportunities(lines: list[tuple[int, str]], name: str) -> RateTrace:
    times_ms: list[int] = []
    for number, line in lines:
        if not (line.isascii() and line.isdigit()):
            reason = f"{line!r} is neither a time in whole milliseconds nor the header {CSV_HEADER}"
            raise _wrong(name, number, reason)
        t_ms = float(line)  # takes any number of digits, which int() does not
        _check_length(name, number, t_ms)
        times_ms.append(int(t_ms))
        if times_ms[-1] < max(times_ms[-2:]):
            raise _wrong(name, number, "times must not go back")
    opportunities = Counter(times_ms)
    period_ms = times_ms[-1]
    if period_ms == 0:
        raise ConfigError(f"{name}: every time is 0; a trace needs a duration")
    opportunities[period_ms] += opportunities.pop(0, 0)  # time 0 is the end of the round before
    ends_ms = sorted(opportunities)
    starts_ms = [0, *ends_ms[:-1]]
    kbps = [
        opportunities[end] * _OPPORTUNITY_BITS / (end - start)
        for start, end in zip(starts_ms, ends_ms, strict=True)
    ]
    starts_ns = tuple(start * NS_PER_MS for start in starts_ms)
    return RateTrace(starts_ns, tuple(kbps), period_ms * NS_PER_MS)


def _check_length(name: str, number: int, length_ms: float) -> None:
    if length_ms > _LONGEST_MS:
        raise _wrong(name, number, "the trace is longer than a day; times are milliseconds")


def _wrong(name: str, number: int, reason: str) -> ConfigError:
    return ConfigError(f"{name}, line {number}: {reason}")


class RelayClient(ReportingHelper[list[PacketRecord]]):
    """One relay process between the video ends.

    `on_packets` and `on_failure` are called in the reading thread; a relay that ends unasked is a
    failure. Records name a packet's delivery when it is decided, up to the link's delay ahead of
    time.
    """

    def __init__(
        self,
        log_directory: Path | None,
        on_packets: Callable[[list[PacketRecord]], None],
        on_failure: Callable[[str, BaseException], None],
    ) -> None:
        super().__init__(
            "relay",
            "tams_app.video.live.relay",
            log_directory=log_directory,
            report_type=list[PacketRecord],
            on_report=on_packets,
            on_failure=on_failure,
            ended_unasked="the link relay ended unasked, so no video arrives; "
            "end this session and start anew",
        )

    def emulate(
        self, network: Network, exits: Mapping[str, ViewPorts], seed: int, epoch_ns: int
    ) -> dict[str, ViewPorts]:
        """Start the relay; per view the entrances to send to. HelperError if it cannot start.

        `exits` say per view where the link's flows come out (what the ends have bound). A trace
        begins at `epoch_ns` of the machine's monotonic clock.
        """
        ready = self.start(
            {
                "network": network.model_dump(mode="json"),
                "seed": seed,
                "epoch_ns": epoch_ns,
                "exits": {view: asdict(ports) for view, ports in exits.items()},
            }
        )
        return {view: ViewPorts(**ports) for view, ports in ready["entrances"].items()}
