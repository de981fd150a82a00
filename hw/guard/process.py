"""The guard: a helper process that stops the arm when the control loop's heartbeat ends.

`python -m hw.guard.process SPECIFICATION`, which is `guard_specification` as JSON; the ready line
holds the UDP `port` for the heartbeats and the `scheduler` that was granted.
It has its own connection to the arm and shares nothing with the application: one that was killed,
stopped or stalled still stops the arm.
"""

from __future__ import annotations

import pkgutil
import socket
from enum import Enum
from typing import TYPE_CHECKING, Any

from hw.guard.link import LOOPBACK, GuardMessage, Heartbeat, decode_heartbeat
from tams_app.errors import TamsError
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import GUARD_PRIORITY, use_fifo
from tams_app.units import NS_PER_MS

if TYPE_CHECKING:  # the guard starts in milliseconds
    from hw.arm import StopChannel

POLL_S = 0.01
FAREWELL_STOP_TIMEOUT_S = 2.0


class Watch(Enum):
    """What the guard is doing."""

    IDLE = "idle"  # never armed, or disarmed
    ARMED = "armed"
    LATCHED = "latched"  # stopped the arm; only a new arming ends it


class HeartbeatWatch:
    """Decides when the heartbeat is lost. Pure: time and heartbeats come in, decisions go out."""

    def __init__(self, timeout_ns: int) -> None:
        self._timeout_ns = timeout_ns
        self._arming = 0
        self._sequence = 0
        self._last_beat_ns = 0
        self.watch = Watch.IDLE

    @property
    def last_heard(self) -> tuple[int, int]:
        """Arming and sequence of the newest beat that counted."""
        return self._arming, self._sequence

    def hear(self, now_ns: int, heartbeat: Heartbeat) -> None:
        """Take in one heartbeat; late ones of an older or ended arming change nothing."""
        if heartbeat.arming < self._arming:
            return
        if heartbeat.arming > self._arming:
            self._begin(now_ns, heartbeat)
        elif self.watch is Watch.ARMED and heartbeat.sequence > self._sequence:
            self._continue(now_ns, heartbeat)

    def lost(self, now_ns: int) -> bool:
        """True once when the heartbeat has been silent for too long; latches."""
        silent_ns = now_ns - self._last_beat_ns
        if self.watch is not Watch.ARMED or silent_ns <= self._timeout_ns:
            return False
        self.watch = Watch.LATCHED
        return True

    def _begin(self, now_ns: int, heartbeat: Heartbeat) -> None:
        self._arming = heartbeat.arming
        self.watch = Watch.IDLE
        if heartbeat.message is GuardMessage.BEAT:
            self.watch = Watch.ARMED
            self._sequence, self._last_beat_ns = heartbeat.sequence, now_ns

    def _continue(self, now_ns: int, heartbeat: Heartbeat) -> None:
        if heartbeat.message is GuardMessage.DISARM:
            self.watch = Watch.IDLE
        elif heartbeat.message is GuardMessage.BEAT:
            self._sequence, self._last_beat_ns = heartbeat.sequence, now_ns


class Guard:
    """Joins heartbeat, watch and stop; `step` is its loop's body."""

    def __init__(
        self, heartbeats: socket.socket, watch: HeartbeatWatch, arm: StopChannel, clock: Clock
    ) -> None:
        self._heartbeats = heartbeats
        self._watch = watch
        self._arm = arm
        self._clock = clock
        self._peer: tuple[str, int] | None = None  # who sent the last heartbeat

    def step(self) -> None:
        """Wait up to POLL_S for heartbeats, answer them, and stop the arm if they ended.

        The stop is told to the application unasked: its next tick knows why the arm stands.
        Everything queued is heard before silence is judged: a guard that was itself stalled must
        not take its own absence for the application's.
        """
        self._heartbeats.settimeout(POLL_S)
        while True:
            try:
                data, sender = self._heartbeats.recvfrom(64)
            except (TimeoutError, BlockingIOError):
                break
            self._answer(data, sender)
            self._heartbeats.setblocking(False)
        if self._watch.lost(self._clock.now_ns()):
            self._arm.request_stop()
            if self._peer is not None:
                self._acknowledge(*self._watch.last_heard, self._peer)

    def farewell(self) -> None:
        """The parent is gone or ends the guard: stop the arm if it was still armed."""
        if self._watch.watch is Watch.ARMED:
            self._arm.request_stop()
        if self._arm.pending:
            self._arm.wait_acknowledged(FAREWELL_STOP_TIMEOUT_S)

    def _answer(self, data: bytes, sender: tuple[str, int]) -> None:
        heartbeat = decode_heartbeat(data)
        if heartbeat is None:
            return
        self._watch.hear(self._clock.now_ns(), heartbeat)
        self._peer = sender
        self._acknowledge(heartbeat.arming, heartbeat.sequence, sender)

    def _acknowledge(self, arming: int, sequence: int, peer: tuple[str, int]) -> None:
        answer = Heartbeat(
            GuardMessage.ACKNOWLEDGEMENT,
            arming,
            sequence,
            latched=self._watch.watch is Watch.LATCHED,
            arm_lost=bool(self._arm.failure),
        )
        try:
            self._heartbeats.sendto(answer.encode(), peer)
        except OSError:  # the application's socket is gone: the heartbeat ends, which is watched
            return


def main() -> None:
    """The process: set up, say ready, watch until told to end."""
    side = HelperSide()
    scheduler = use_fifo(GUARD_PRIORITY)
    specification = side.specification
    arm = _stop_channel(specification)
    watch = HeartbeatWatch(round(specification["heartbeat_timeout_ms"] * NS_PER_MS))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heartbeats:
        heartbeats.bind((LOOPBACK, 0))
        try:
            arm.start()
        except TamsError as error:
            side.fail(str(error))
            return
        try:
            guard = Guard(heartbeats, watch, arm, MonotonicClock())
            side.ready(port=heartbeats.getsockname()[1], scheduler=scheduler)
            while not side.stop_requested.is_set():
                guard.step()
            guard.farewell()
        finally:
            arm.close()


def _stop_channel(specification: dict[str, Any]) -> StopChannel:
    """The stop channel of the configured arm's kind, not connected yet."""
    channel: StopChannel = pkgutil.resolve_name(specification["stop_channel"])(
        specification["host"],
        specification["control_port"],
        specification["reply_timeout_s"],
        name="guard-stop",
    )
    return channel


if __name__ == "__main__":
    main()
