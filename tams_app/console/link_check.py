"""`doctor --link`: measures the network between the two computers, and proposes its settings."""

from __future__ import annotations

import json
import os
import select
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np
from msgspec.structs import replace
from pydantic import ValidationError

from hw.link.controller import LinkController
from tams_app.config import LinkConfig
from tams_app.errors import HelperError, TamsError
from tams_app.link.addresses import Address, addresses_of, called, datagram_socket
from tams_app.link.caller import Caller
from tams_app.link.channel import LINK, PING
from tams_app.link.gaps import advice, lost_after_for
from tams_app.link.gateway_client import NO_ANSWER, Endpoint
from tams_app.link.keys import LOOPBACK_KEY, read_key
from tams_app.link.messages import HandMessage
from tams_app.printing import Console
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.units import NS_PER_MS, NS_PER_S

_ANSWER_NS = 8 * NS_PER_S
_PINGS, _PING_EVERY_NS = 1250, 8 * NS_PER_MS  # as often as samples of the hand in a session
_QUIET_NS = NS_PER_S
_STAMPS = ("sent_ns", "echo_ns", "echo_heard_ns", "pose_ns", "buttons_ns")
_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_SAMPLE = HandMessage(0, True, 0, 0, 0, "ok", _POSE, 0, 0, 0.0, 0.0, False, False, False, ())


@dataclass(frozen=True, slots=True)
class LinkMeasured:
    """The measured network between the two computers.

    lost_fraction: of the echoes. gaps: between those that came, in words. latency_ms, jitter_ms,
    lost_after_ms (None: no value of it helps): for `link` in the configuration of the robot's side.
    link_gaps_a_minute: how many breaks hold the arm (*link gaps*) even then.
    """

    round_trip_ms: dict[str, float]  # p50, p95, p99
    lost_fraction: float
    latency_ms: float
    jitter_ms: float
    gaps: str
    lost_after_ms: float | None
    link_gaps_a_minute: float


def run_link_check(
    endpoint: Endpoint, as_json: bool = False, console: Console | None = None
) -> None:
    """Measure the link to a `robot` that runs, and print what was found."""
    console = console or Console()
    if not as_json:
        where = called(endpoint.host, endpoint.port)
        console.print(f"measuring the link to {where}, about ten seconds", soft_wrap=True)
    try:
        with _Prober(endpoint, MonotonicClock()) as prober:
            prober.connect()
            found = measured(prober.echoes())
    except OSError as error:
        raise HelperError(f"the network refuses: {error.strerror or error}") from error
    if as_json:
        console.out(json.dumps(asdict(found)))
    for line in () if as_json else findings(found):
        console.print(line, soft_wrap=True)


def measured(echoes: list[tuple[int, int]]) -> LinkMeasured:
    """Evaluate echoes: when each was sent and came back [ns]; TamsError if there was none."""
    if not echoes:
        raise TamsError("the robot's side answers no measurement: is it still running?")
    trips_ms = np.diff(echoes)[:, 0] / NS_PER_MS
    p50, p95, p99 = np.percentile(trips_ms, (50, 95, 99)).tolist()
    way_ms = {"latency_ms": p50 / 2, "jitter_ms": p95 - float(trips_ms.min())}
    link = LinkConfig().model_copy(update=way_ms)
    found = _held(echoes, link)[0], _PINGS * _PING_EVERY_NS / NS_PER_S, link
    prescribed = {"lost_after_ms": lost_after_for(*found) or link.lost_after_ms}
    too_often = _held(echoes, link.model_copy(update=prescribed))[1]
    return LinkMeasured(
        round_trip_ms={"p50": p50, "p95": p95, "p99": p99},
        lost_fraction=1 - len(echoes) / _PINGS,
        **way_ms,
        gaps=advice(*found, too_often),
        lost_after_ms=lost_after_for(*found, too_often),
        link_gaps_a_minute=too_often * 60.0 / found[1],
    )


def _held(echoes: list[tuple[int, int]], link: LinkConfig) -> tuple[list[float], int]:
    """Gaps [ms] of samples that come as the echoes did, and how many breaks were too many."""
    controller = LinkController(link, lambda _: None, lambda _: None)
    controller.start()
    counted_ns = []
    for sent_ns, received_ns in echoes:
        controller.sample(received_ns)
        controller.take(replace(_SAMPLE, **dict.fromkeys(_STAMPS, sent_ns)), received_ns)
        if controller.counted_ns == received_ns:
            counted_ns.append(received_ns)
    return (np.diff(counted_ns) / NS_PER_MS).tolist(), controller.too_often


def findings(found: LinkMeasured) -> Iterator[str]:
    """The measurements in words, and the section of the configuration that follows from them."""
    trips = ", ".join(f"{value:.1f} ms ({name})" for name, value in found.round_trip_ms.items())
    yield f"round trip: {trips}; lost {found.lost_fraction:.1%}"
    yield found.gaps
    if found.link_gaps_a_minute and found.lost_after_ms is not None:
        yield f"whatever is set, {found.link_gaps_a_minute:.0f} a minute hold the arm (link gaps)"
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
        self._socket = datagram_socket(family)
        self._socket.setblocking(False)
        self._end = Caller(key, addresses, os.urandom)

    def __enter__(self) -> _Prober:
        return self

    def __exit__(self, *_: object) -> None:
        self._send(self._end.goodbye(self._clock.now_ns()))
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
            list(self._received(NS_PER_S // 20))

    def echoes(self) -> list[tuple[int, int]]:
        """The times [ns] at which each echo that came back was sent and received."""
        sent_ns: dict[int, int] = {}
        echoes = []
        for number in range(_PINGS):
            sent_ns[number] = self._clock.now_ns()
            ping = PING + number.to_bytes(4)
            self._send(self._end.message(ping, sent_ns[number], LINK))
            wait_ns = _PING_EVERY_NS if number < _PINGS - 1 else _QUIET_NS
            for now_ns, echo in self._received(wait_ns):
                echoed = int.from_bytes(echo)
                if echoed in sent_ns:
                    echoes.append((sent_ns.pop(echoed), now_ns))
        return echoes

    def _send(self, datagrams: list[tuple[bytes, Address]]) -> None:
        for datagram in datagrams:
            with suppress(OSError):  # a network loses some; of several addresses one may answer
                self._socket.sendto(*datagram)

    def _received(self, wait_ns: int) -> Iterator[tuple[int, bytes]]:
        """The echoes that come within `wait_ns`, each with its time."""
        deadline_ns = self._clock.now_ns() + wait_ns
        while (left_ns := deadline_ns - self._clock.now_ns()) > 0:
            now_ns = self._clock.now_ns()
            self._send(self._end.step(now_ns))
            due_ns = self._end.due_ns(now_ns)
            step_ns = left_ns if due_ns is None else max(0, min(left_ns, due_ns - now_ns))
            if not select.select([self._socket], [], [], step_ns / NS_PER_S)[0]:
                continue
            datagram, address = self._socket.recvfrom(65_536)
            now_ns = self._clock.now_ns()
            received = self._end.receive(datagram, address, now_ns)
            self._send(received.replies)
            if received.left:
                raise HelperError("the robot's side ended meanwhile: start it and measure again")
            for echo in received.echoes:
                yield now_ns, echo
