"""The heartbeat between the control loop and the guard: records in memory that both share.

A beat keeps the guard from stopping the arm; every beat is answered, so that a guard that is gone
or cannot reach the arm is seen as well. While the arm is not armed the beats are queries, which are
answered and watch over nothing. When the guard stops the arm it says so unasked. Nobody is woken by
either: the guard looks at a rate of its own, the control loop in each tick.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from contextlib import ExitStack
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from hw.arms import arm_kind
from hw.guard.motion import Cause, Motion, MotionLimits
from tams_app.runtime.shared_ring import RingShape, SharedRing, create_block, remove_block
from tams_app.units import NS_PER_MS, NS_PER_S

if TYPE_CHECKING:  # the guard itself starts without the configuration's libraries
    from tams_app.config import ArmConfig, LimitsConfig

# magic, kind, status bits, arming, sequence, motion, speed, cause
_RECORD = struct.Struct("!4sBBIQBfB")
_MAGIC = b"TAMG"
_STATUS_LATCHED = 1
_STATUS_ARM_LOST = 2
_STATUS_DEADMAN = 4
BEATS = RingShape(_RECORD.size, 256)  # two seconds: a guard that was held up hears all of them
ANSWERS = RingShape(_RECORD.size, 8)  # two are usual; what the guard says last counts


_BRAKING_NS = 200 * NS_PER_MS  # stop profile, and reports that come late


def guard_specification(config: ArmConfig, limits: LimitsConfig) -> dict[str, Any]:
    """What the process `hw.guard.process` is started with."""
    kind = arm_kind(config.model)
    return {
        "stop_channel": kind.stop_channel,
        "report_watch": kind.report_watch,
        "host": config.host,
        "control_port": config.control_port,
        "report_port": config.report_port,
        "reply_timeout_s": config.reply_timeout_s,
        "heartbeat_timeout_ms": config.guard.heartbeat_timeout_ms,
        "motion": motion_limits(config, limits)._asdict(),
    }


def motion_limits(config: ArmConfig, limits: LimitsConfig) -> MotionLimits:
    """What the guard lets the arm do, in metres, radians and nanoseconds."""
    return MotionLimits(
        grace_ns=_BRAKING_NS + round(config.velocity_deadman_s * NS_PER_S),
        speed_m_s=limits.max_speed_mm_s / 1000,
        home_rad_s=math.radians(config.ready_speed_deg_s),
        leash_m=limits.leash_mm / 1000,
        low=[edge / 1000 for edge in limits.box_min_mm],
        high=[edge / 1000 for edge in limits.box_max_mm],
        radius_min=limits.radius_min_mm / 1000,
        radius_max=limits.radius_max_mm / 1000,
        floor=limits.floor_mm / 1000,
        margin_m=config.boundary_margin_mm / 1000,
    )


class GuardMessage(IntEnum):
    """What a record says."""

    BEAT = 1
    DISARM = 2
    ACKNOWLEDGEMENT = 3
    QUERY = 4  # arms nothing and disarms nothing


_MESSAGES = {message.value: message for message in GuardMessage}
_MOTIONS = {motion.value: motion for motion in Motion}
_CAUSES = {cause.value: cause for cause in Cause}


class Heartbeat(NamedTuple):
    """One record: what the application says of itself in beats, the guard in acknowledgements.

    `arming` counts the times the arm was armed, `sequence` the beats since the link was made.
    """

    message: GuardMessage
    arming: int
    sequence: int
    latched: bool = False  # the guard stopped the arm and waits for a new arming
    arm_lost: bool = False  # one of the guard's own connections to the arm is silent
    cause: Cause = Cause.NONE  # of that stop
    motion: Motion = Motion.REST  # what the application has the arm do ...
    deadman: bool = False  # ... and whether the operator holds the deadman for it
    speed: float = 0.0  # how fast at most: of the TCP [m/s], on the way home of a joint [rad/s]

    @property
    def commanded(self) -> Motion:
        """The motion that this beat allows: none without the deadman."""
        return self.motion if self.deadman else Motion.REST

    def encode(self) -> bytes:
        status = (
            _STATUS_LATCHED * self.latched
            | _STATUS_ARM_LOST * self.arm_lost
            | _STATUS_DEADMAN * self.deadman
        )
        return _RECORD.pack(
            _MAGIC,
            self.message,
            status,
            self.arming,
            self.sequence,
            self.motion,
            self.speed,
            self.cause,
        )


def decode_heartbeat(data: bytes) -> Heartbeat | None:
    """The heartbeat in a record, None if it is something else."""
    if len(data) != _RECORD.size:
        return None
    magic, kind, status, arming, sequence, moves, speed, caused = _RECORD.unpack(data)
    message, motion, cause = _MESSAGES.get(kind), _MOTIONS.get(moves), _CAUSES.get(caused)
    if magic != _MAGIC or message is None or motion is None or cause is None:
        return None
    if not speed >= 0.0:  # nor NaN
        return None
    return Heartbeat(
        message,
        arming,
        sequence,
        latched=bool(status & _STATUS_LATCHED),
        arm_lost=bool(status & _STATUS_ARM_LOST),
        cause=cause,
        motion=motion,
        deadman=bool(status & _STATUS_DEADMAN),
        speed=speed,
    )


class GuardMemory:
    """The beats and the answers to them, in shared memory of the name that the guard tells."""

    def __init__(self, name: str) -> None:
        """Open it, or make it if it is not there."""
        with ExitStack() as opened:
            beats = opened.enter_context(create_block(f"{name}-beats", BEATS.size))
            answers = opened.enter_context(create_block(f"{name}-answers", ANSWERS.size))
            self._opened = opened.pop_all()
        self._name = name
        self.beats = SharedRing(beats, BEATS)
        self.answers = SharedRing(answers, ANSWERS)

    def hide(self) -> None:
        """Take the name away, once both have it open; may be called twice."""
        remove_block(f"{self._name}-beats")
        remove_block(f"{self._name}-answers")

    def close(self) -> None:
        """Give it back; may be called twice."""
        self._opened.close()


class GuardLink:
    """The control loop's side: `beat` every tick, between `arm` and `disarm` it is watched.

    For one thread. Nothing here blocks or calls the system while the guard answers.
    """

    def __init__(self, memory: GuardMemory, silence_ns: int, runs: Callable[[], bool]) -> None:
        """No answer for `silence_ns` means that the guard is gone.

        `runs`: whether its process does; asked only when a beat finds no new answer.
        """
        self._silence_ns = silence_ns
        self._runs = runs
        self._memory = memory
        memory.hide()
        self._closed = False
        self._arming = 0
        self._sequence = 0
        self.armed = False
        self._answers = 0  # heard so far
        self._heard_ns: int | None = None
        self.ended = False  # the guard's process
        self._acknowledged = False
        self.latched = False
        self.cause = Cause.NONE  # of the latch
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
        self.cause = Cause.NONE

    def beat(
        self,
        now_ns: int,
        motion: Motion = Motion.REST,
        deadman: bool = False,
        speed: float = 0.0,
    ) -> None:
        """Take in what the guard said, and say that the control loop runs; not armed, ask only.

        `motion`: what was commanded last, with the deadman's state then, and how fast at most: of
        the TCP [m/s], on the way to the ready pose of the fastest joint [rad/s].
        """
        if self._heard_ns is None:
            self._heard_ns = now_ns
        self._hear(now_ns)
        self._sequence += 1
        if self.armed:
            self._say(GuardMessage.BEAT, motion, deadman, speed)
        else:
            self._say(GuardMessage.QUERY)

    def disarm(self) -> None:
        """End the watch without a stop; the caller sees to it that the arm stands."""
        if self.armed:
            self.armed = False
            self._sequence += 1
            self._say(GuardMessage.DISARM)

    def answers(self, now_ns: int) -> bool:
        """While armed: the guard is there and its last answer is fresh. True if not armed."""
        return not self.armed or (not self.ended and self.is_fresh(now_ns))

    def is_fresh(self, now_ns: int) -> bool:
        """Whether the guard's last answer is fresh, armed or not; true before the first beat."""
        return self._heard_ns is None or now_ns - self._heard_ns <= self._silence_ns

    def alive(self, now_ns: int) -> bool:
        """While armed: the guard answers and could stop the arm. True if not armed."""
        return self.answers(now_ns) and not (self.armed and self.arm_lost)

    def close(self) -> None:
        """Disarm and let go; may be called twice."""
        if not self._closed:
            self._closed = True
            self.disarm()
            self._memory.close()

    def _say(
        self,
        message: GuardMessage,
        motion: Motion = Motion.REST,
        deadman: bool = False,
        speed: float = 0.0,
    ) -> None:
        beat = Heartbeat(
            message, self._arming, self._sequence, motion=motion, deadman=deadman, speed=speed
        )
        self._memory.beats.put(beat.encode())

    def _hear(self, now_ns: int) -> None:
        answers = self._memory.answers
        written = answers.written()
        if written == self._answers:
            self.ended = self.ended or not self._runs()
            return
        for number in range(max(self._answers, written - ANSWERS.heads), written):
            record = answers.head(number)
            if record is not None:  # else it is older than those that are kept
                self._take(record, now_ns)
        self._answers = written

    def _take(self, record: bytes, now_ns: int) -> None:
        answer = decode_heartbeat(record)
        if answer is None or answer.arming != self._arming:
            return
        self._heard_ns = now_ns
        if self.armed:
            self._acknowledged = True
            if answer.latched and not self.latched:  # until the next arming
                self.latched, self.cause = True, answer.cause
        self.arm_lost = answer.arm_lost
