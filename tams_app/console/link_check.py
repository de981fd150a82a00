"""`doctor --link`: measures the network between the two computers, and proposes its settings."""

from __future__ import annotations

import json
import os
import select
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np
from pydantic import ValidationError

from tams_app.config import LinkConfig
from tams_app.errors import HelperError, TamsError
from tams_app.link.addresses import addresses_of, called, datagram_socket
from tams_app.link.echoes import number_of, ping
from tams_app.link.ends import GOODBYE
from tams_app.link.gaps import advice, lost_after_for
from tams_app.link.gateway_client import NO_ANSWER, Endpoint
from tams_app.link.keys import LOOPBACK_KEY, read_key
from tams_app.link.operator_end import OperatorEnd
from tams_app.printing import Console
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.units import NS_PER_MS, NS_PER_S

_ANSWER_NS = 8 * NS_PER_S
_PINGS, _PING_EVERY_NS = 500, 20 * NS_PER_MS
_QUIET_NS = NS_PER_S


@dataclass(frozen=True, slots=True)
class LinkMeasured:
    """The measured network between the two computers.

    lost_fraction: of the echoes. gaps: between those that came, in words. latency_ms, jitter_ms,
    lost_after_ms (None: no value of it helps): for `link` in the configuration of the robot's side.
    """

    round_trip_ms: dict[str, float]  # p50, p95, p99
    lost_fraction: float
    latency_ms: float
    jitter_ms: float
    gaps: str
    lost_after_ms: float | None


def run_link_check(
    endpoint: Endpoint, as_json: bool = False, console: Console | None = None
) -> int:
    """Measure the link to a `robot` that runs, and print what was found; the exit code."""
    console = console or Console()
    if not as_json:
        where = called(endpoint.host, endpoint.port)
        console.print(f"measuring the link to {where}, about ten seconds", soft_wrap=True)
    try:
        found = _measure(endpoint)
    except OSError as error:
        raise HelperError(f"the network refuses: {error.strerror or error}") from error
    if as_json:
        console.out(json.dumps(asdict(found)), highlight=False)
        return 0
    for line in findings(found):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    return 0


def _measure(endpoint: Endpoint) -> LinkMeasured:
    with _Prober(endpoint, MonotonicClock()) as prober:
        prober.connect()
        round_trips_ms = prober.round_trips_ms()
        gaps_ms = np.diff(prober.arrived_ns) / NS_PER_MS
        return measured(round_trips_ms, gaps_ms.tolist())


def measured(round_trips_ms: list[float], gaps_ms: list[float]) -> LinkMeasured:
    """Evaluate echoes, and the gaps between them; TamsError if there was no echo."""
    if not round_trips_ms:
        raise TamsError("the robot's side answers no measurement: is it still running?")
    of_gaps = gaps_ms, _PINGS * _PING_EVERY_NS / NS_PER_S, LinkConfig().lost_after_ms
    p50, p95, p99 = np.percentile(round_trips_ms, (50, 95, 99)).tolist()
    return LinkMeasured(
        round_trip_ms={"p50": p50, "p95": p95, "p99": p99},
        lost_fraction=1 - len(round_trips_ms) / _PINGS,
        latency_ms=p50 / 2,
        jitter_ms=p95 - min(round_trips_ms),
        gaps=advice(*of_gaps),
        lost_after_ms=lost_after_for(*of_gaps),
    )


def findings(found: LinkMeasured) -> Iterator[str]:
    """The measurements in words, and the section of the configuration that follows from them."""
    trips = ", ".join(f"{value:.1f} ms ({name})" for name, value in found.round_trip_ms.items())
    yield f"round trip: {trips}; lost {found.lost_fraction:.1%}"
    yield found.gaps
    measured_ms = {"latency_ms": round(found.latency_ms, 1), "jitter_ms": round(found.jitter_ms, 1)}
    if found.lost_after_ms is not None and found.lost_after_ms != LinkConfig().lost_after_ms:
        measured_ms["lost_after_ms"] = found.lost_after_ms
    try:
        longest_ms = LinkConfig(**measured_ms).longest_age_ms()
    except ValidationError:
        yield (
            f"latency {found.latency_ms:.0f} ms, jitter {found.jitter_ms:.0f} ms: no arm may be "
            "moved over this network. Stop what else fills it (its queue may be what delays), "
            "then measure again"
        )
        return
    yield "for the configuration of the robot's side:"
    yield "link:"
    yield from (f"  {key}: {value}" for key, value in measured_ms.items())
    yield f"  # a sample of the hand that may be older than {longest_ms:.0f} ms moves nothing"


class _Prober:
    """The operator's end of a link that carries nothing but measurements."""

    def __init__(self, endpoint: Endpoint, clock: Clock) -> None:
        key = LOOPBACK_KEY if endpoint.key is None else read_key(endpoint.key)
        family, addresses = addresses_of(
            endpoint.host, endpoint.port, loopback_only=endpoint.key is None
        )
        self._clock = clock
        self.arrived_ns: list[int] = []  # when echoes came
        self._socket = datagram_socket(family)
        self._socket.setblocking(False)
        self._end = OperatorEnd(key, addresses, os.urandom)

    def __enter__(self) -> _Prober:
        return self

    def __exit__(self, *_: object) -> None:
        self._send(GOODBYE)
        self._socket.close()

    def connect(self) -> None:
        """Call until there is an answer; HelperError with the reason if there is none."""
        deadline_ns = self._clock.now_ns() + _ANSWER_NS
        while not self._end.connected:
            if self._end.busy:
                raise HelperError(
                    "the robot's side has another operator, or had one a moment ago: measure when "
                    "they have left"
                )
            if self._clock.now_ns() >= deadline_ns:
                raise HelperError(f"{NO_ANSWER}; is `robot` running there?")
            for call in self._end.step(self._clock.now_ns()):
                with suppress(OSError):  # one address of several: the others may answer
                    self._socket.sendto(*call)
            list(self._received(NS_PER_S // 20))

    def round_trips_ms(self) -> list[float]:
        """Of each echo that came back [ms]."""
        sent_ns: dict[int, int] = {}
        trips_ms = []
        for number in range(_PINGS):
            sent_ns[number] = self._clock.now_ns()
            self._send(ping(number))
            wait_ns = _PING_EVERY_NS if number < _PINGS - 1 else _QUIET_NS
            for now_ns, message in self._received(wait_ns):
                echoed = number_of(message)
                if echoed is not None and echoed in sent_ns:
                    self.arrived_ns.append(now_ns)
                    trips_ms.append((now_ns - sent_ns.pop(echoed)) / NS_PER_MS)
        return trips_ms

    def _send(self, message: bytes) -> None:
        if (addressed := self._end.message(message, self._clock.now_ns())) is not None:
            try:
                self._socket.sendto(*addressed)
            except BlockingIOError:
                return  # a full buffer loses it, as a network does

    def _received(self, wait_ns: int) -> Iterator[tuple[int, bytes]]:
        """The messages that come within `wait_ns`, each with its time."""
        deadline_ns = self._clock.now_ns() + wait_ns
        while (left_ns := deadline_ns - self._clock.now_ns()) > 0:
            if not select.select([self._socket], [], [], left_ns / NS_PER_S)[0]:
                return
            datagram, address = self._socket.recvfrom(65_536)
            now_ns = self._clock.now_ns()
            heard = self._end.receive(datagram, address, now_ns)
            for reply in heard.replies:
                self._socket.sendto(*reply)
            if heard.connected:
                self._send(ping(_PINGS))  # the first message confirms the call
            if heard.left:
                raise HelperError("the robot's side ended meanwhile: start it and measure again")
            if heard.message is not None:
                yield now_ns, heard.message
