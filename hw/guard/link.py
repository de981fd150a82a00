"""The heartbeat between the control loop and the guard: datagrams on loopback, both ways.

A beat keeps the guard from stopping the arm; every beat is answered, so that a guard that is gone
or cannot reach the arm is seen as well. While the arm is not armed the beats are queries, which are
answered and watch over nothing. When the guard stops the arm it says so unasked.
"""

from __future__ import annotations

import socket
import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from hw.arms import arm_kind

if TYPE_CHECKING:  # the guard itself starts without the configuration's libraries
    from tams_app.config import ArmConfig

LOOPBACK = "127.0.0.1"
_DATAGRAM = struct.Struct("!4sBBIQ")  # magic, kind, status bits, arming, sequence
_MAGIC = b"TAMG"
_STATUS_LATCHED = 1
_STATUS_ARM_LOST = 2
_MAX_ANSWERS_PER_BEAT = 8  # one is usual; a guard that was held up sends many at once


def guard_specification(config: ArmConfig) -> dict[str, Any]:
    """What the process `hw.guard.process` is started with."""
    return {
        "stop_channel": arm_kind(config.model).stop_channel,
        "host": config.host,
        "control_port": config.control_port,
        "reply_timeout_s": config.reply_timeout_s,
        "heartbeat_timeout_ms": config.guard.heartbeat_timeout_ms,
    }


class GuardMessage(IntEnum):
    """What a datagram says."""

    BEAT = 1
    DISARM = 2
    ACKNOWLEDGEMENT = 3
    QUERY = 4  # arms nothing and disarms nothing


_MESSAGES = {message.value: message for message in GuardMessage}


class Heartbeat(NamedTuple):
    """One datagram; `latched` and `arm_lost` are the guard's and only in acknowledgements.

    `arming` counts the times the arm was armed, `sequence` the beats since the link was made.
    """

    message: GuardMessage
    arming: int
    sequence: int
    latched: bool = False  # the guard stopped the arm and waits for a new arming
    arm_lost: bool = False  # the guard's own connection to the arm does not answer

    def encode(self) -> bytes:
        status = _STATUS_LATCHED * self.latched | _STATUS_ARM_LOST * self.arm_lost
        return _DATAGRAM.pack(_MAGIC, self.message, status, self.arming, self.sequence)


def decode_heartbeat(data: bytes) -> Heartbeat | None:
    """The heartbeat in a datagram, None if it is something else."""
    if len(data) != _DATAGRAM.size:
        return None
    magic, kind, status, arming, sequence = _DATAGRAM.unpack(data)
    message = _MESSAGES.get(kind)
    if magic != _MAGIC or message is None:
        return None
    return Heartbeat(
        message,
        arming,
        sequence,
        latched=bool(status & _STATUS_LATCHED),
        arm_lost=bool(status & _STATUS_ARM_LOST),
    )


class GuardLink:
    """The control loop's side: `beat` every tick, between `arm` and `disarm` it is watched.

    For one thread. Nothing here blocks; a beat costs some 10 µs once the caches are warm.
    """

    def __init__(self, port: int, silence_ns: int) -> None:
        """`port` is in the guard's ready line; no answer for `silence_ns` means it is gone."""
        self._silence_ns = silence_ns
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect((LOOPBACK, port))
        self._arming = 0
        self._sequence = 0
        self.armed = False
        self._heard_ns: int | None = None
        self._refused = False  # the guard's port is closed: its process has ended
        self._acknowledged = False
        self.latched = False
        self.arm_lost = False

    @property
    def acknowledged(self) -> bool:
        """The guard has answered a beat of this arming: it watches from here on."""
        return self.armed and self._acknowledged

    def arm(self) -> None:
        """Begin a new arming: the next beat arms the guard, also after it has stopped the arm."""
        self._arming += 1
        self.armed = True
        self._heard_ns = None
        self._acknowledged = False
        self.latched = False

    def beat(self, now_ns: int) -> None:
        """Take in what the guard said, and say that the control loop runs; not armed, ask only."""
        if self._heard_ns is None:
            self._heard_ns = now_ns
        self._receive(now_ns)
        self._sequence += 1
        self._send(GuardMessage.BEAT if self.armed else GuardMessage.QUERY)

    def disarm(self) -> None:
        """End the watch without a stop; the caller sees to it that the arm stands."""
        if self.armed:
            self.armed = False
            self._sequence += 1
            self._send(GuardMessage.DISARM)

    def answers(self, now_ns: int) -> bool:
        """While armed: the guard is there and its last answer is fresh. True if not armed."""
        if not self.armed or self._heard_ns is None:
            return True
        return not self._refused and now_ns - self._heard_ns <= self._silence_ns

    def alive(self, now_ns: int) -> bool:
        """While armed: the guard answers and could stop the arm. True if not armed."""
        return self.answers(now_ns) and not (self.armed and self.arm_lost)

    def close(self) -> None:
        """Disarm and let go; may be called twice."""
        if self._socket.fileno() >= 0:
            self.disarm()
            self._socket.close()

    def _send(self, message: GuardMessage) -> None:
        try:
            self._socket.send(Heartbeat(message, self._arming, self._sequence).encode())
        except ConnectionRefusedError:
            self._refused = True
        except OSError:  # no room at the moment: the guard hears of the next beat
            return

    def _receive(self, now_ns: int) -> None:
        for _ in range(_MAX_ANSWERS_PER_BEAT):
            try:
                answer = decode_heartbeat(self._socket.recv(64))
            except ConnectionRefusedError:
                self._refused = True
                return
            except OSError:  # nothing more there
                return
            if answer is None or answer.arming != self._arming:
                continue
            self._heard_ns = now_ns
            if self.armed:
                self._acknowledged = True
                self.latched = self.latched or answer.latched  # until the next arming
            self.arm_lost = answer.arm_lost
