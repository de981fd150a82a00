"""The guard: a helper process that stops the arm when the control loop's heartbeat ends.

`python -m hw.guard.process SPECIFICATION`, which is `guard_specification` as JSON; the ready line
holds the name of the `memory` for the heartbeats and the `scheduler` that was granted.
It has its own connection to the arm and shares nothing else with the application: one that was
killed, stopped or stalled still stops the arm.
"""

from __future__ import annotations

import pkgutil
import time
from enum import Enum
from typing import TYPE_CHECKING, Any

from hw.guard.link import BEATS, GuardMemory, GuardMessage, Heartbeat, decode_heartbeat
from tams_app.errors import TamsError
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import GUARD_PRIORITY, use_fifo
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS

if TYPE_CHECKING:  # the guard starts in milliseconds
    from hw.arm import StopChannel

POLL_S = 0.005  # a beat is heard this much later at most, and a silence seen
_KEPT_BEATS = BEATS.heads - 8  # the oldest may be overwritten while they are read
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
        self, memory: GuardMemory, watch: HeartbeatWatch, arm: StopChannel, clock: Clock
    ) -> None:
        self._memory = memory
        self._watch = watch
        self._arm = arm
        self._clock = clock
        self._heard = 0  # beats

    def step(self) -> None:
        """Hear and answer the heartbeats, and stop the arm if they ended.

        The stop is told to the application unasked: its next tick knows why the arm stands.
        """
        self._hear()
        if self._watch.lost(self._clock.now_ns()):
            self._arm.request_stop()
            self._answer(*self._watch.last_heard)

    def farewell(self) -> None:
        """The parent is gone or ends the guard: stop the arm if it was still armed."""
        self._hear()  # that it was disarmed just before
        if self._watch.watch is Watch.ARMED:
            self._arm.request_stop()
        if self._arm.pending:
            self._arm.wait_acknowledged(FAREWELL_STOP_TIMEOUT_S)

    def _hear(self) -> None:
        """Everything new, before silence is judged.

        A guard that was itself stalled must not take its own absence for the application's.
        """
        beats = self._memory.beats
        written = beats.written()
        self._heard = max(self._heard, written - _KEPT_BEATS)
        while self._heard < written:
            record = beats.head(self._heard)
            if record is None:  # not to be seen whole yet
                return
            self._heard += 1
            heartbeat = decode_heartbeat(record)
            if heartbeat is not None:
                self._watch.hear(self._clock.now_ns(), heartbeat)
                self._answer(heartbeat.arming, heartbeat.sequence)

    def _answer(self, arming: int, sequence: int) -> None:
        answer = Heartbeat(
            GuardMessage.ACKNOWLEDGEMENT,
            arming,
            sequence,
            latched=self._watch.watch is Watch.LATCHED,
            arm_lost=bool(self._arm.failure),
        )
        self._memory.answers.put(answer.encode())


def main() -> None:
    """The process: set up, say ready, watch until told to end."""
    side = HelperSide()
    scheduler = use_fifo(GUARD_PRIORITY)
    specification = side.specification
    arm = _stop_channel(specification)
    watch = HeartbeatWatch(round(specification["heartbeat_timeout_ms"] * NS_PER_MS))
    try:
        arm.start()
    except TamsError as error:
        side.fail(str(error))
        return
    name = new_block_name()
    memory = GuardMemory(name)
    try:
        guard = Guard(memory, watch, arm, MonotonicClock())
        side.ready(memory=name, scheduler=scheduler)
        while not side.stop_requested.is_set():
            guard.step()
            time.sleep(POLL_S)
        guard.farewell()
    finally:
        arm.close()
        memory.hide()
        memory.close()


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
