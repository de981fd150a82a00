"""Measuring a link: echoes for its delay, trains of packets for what it carries each way.

Both ends of the link answer by themselves (`Answering`, in the gateway), whatever the applications
do; `doctor --link` asks. A train is sent at once, so that its packets leave the bottleneck at its
rate: what it carries is read from the second half of the train, when buffers that let a burst
through are empty.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Final

PREFIX = b"\0"  # of all that the gateways send each other; applications' messages begin otherwise
PING, PONG, ASK, PART, REPORT = b"\0ping", b"\0pong", b"\0ask", b"\0part", b"\0told"
PART_BYTES = 1150  # below the link's MTU of 1200 with what seals it
LONGEST_TRAIN = 400
_NUMBERS = struct.Struct("!II")  # train, and: packets asked for, or number of this one
_SUMS = struct.Struct("!IIIq")  # train, packets, bytes of the second half, and how long it took


@dataclass(frozen=True, slots=True)
class TrainReport:
    """A train as it arrived: packets; bytes of its second half, and the time they took [ns]."""

    train: int
    packets: int
    half_bytes: int
    half_ns: int

    @property
    def kbps(self) -> float | None:
        """The link's rate [kbit/s]; None if too little of the train came to measure it."""
        return self.half_bytes * 8e6 / self.half_ns if self.half_ns > 0 else None


@dataclass(slots=True)
class TrainReceiver:
    """Counts the parts of one train as they come."""

    train: int
    parts: int  # that were sent
    arrivals: list[tuple[int, int]] = field(default_factory=list)  # when, bytes of the datagram

    def part(self, now_ns: int, datagram_bytes: int) -> None:
        """One part has come."""
        self.arrivals.append((now_ns, datagram_bytes))

    def report(self) -> TrainReport:
        """The arrivals so far."""
        half = self.arrivals[len(self.arrivals) // 2 :]
        span_ns = half[-1][0] - half[0][0] if len(half) > 1 else 0
        size_bytes = sum(size for _, size in half[1:])
        return TrainReport(self.train, len(self.arrivals), size_bytes, span_ns)


def ping(number: int) -> bytes:
    """A message that is answered at once."""
    return PING + _NUMBERS.pack(number, 0)


def ask(train: int, parts: int) -> bytes:
    """Asks for a train."""
    return ASK + _NUMBERS.pack(train, parts)


def train_of(train: int, parts: int) -> list[bytes]:
    """The messages of a train."""
    room = bytes(PART_BYTES - len(PART) - _NUMBERS.size)
    return [PART + _NUMBERS.pack(train, parts) + room for _ in range(min(parts, LONGEST_TRAIN))]


def numbers_of(message: bytes, kind: bytes) -> tuple[int, int] | None:
    """The two numbers of a message of `kind`; None if it is another, or cut."""
    if not message.startswith(kind) or len(message) < len(kind) + _NUMBERS.size:
        return None
    first, second = _NUMBERS.unpack_from(message, len(kind))
    return first, second


def report_of(message: bytes) -> TrainReport | None:
    """The report that a message carries; None if it is none."""
    if not message.startswith(REPORT) or len(message) != len(REPORT) + _SUMS.size:
        return None
    return TrainReport(*_SUMS.unpack_from(message, len(REPORT)))


class Answering:
    """An end's answers to the measurements of the other."""

    def __init__(self) -> None:
        self._receiver: Final[dict[int, TrainReceiver]] = {}

    def answers(self, message: bytes, now_ns: int, datagram_bytes: int) -> list[bytes]:
        """The messages to send back, at once; a part of a train is answered by what came so far."""
        if numbers := numbers_of(message, PING):
            return [PONG + message[len(PING) :]]
        if numbers := numbers_of(message, ASK):
            return train_of(*numbers)
        if numbers := numbers_of(message, PART):
            train, parts = numbers
            if train not in self._receiver:
                self._receiver.clear()  # one at a time
            receiver = self._receiver.setdefault(train, TrainReceiver(train, parts))
            receiver.part(now_ns, datagram_bytes)
            seen = receiver.report()
            return [REPORT + _SUMS.pack(seen.train, seen.packets, seen.half_bytes, seen.half_ns)]
        return []
