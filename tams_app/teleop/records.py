"""The input and the output of the teleoperation, of one tick."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.records import ArmState, CommandLink, ControllerSample, Haptic, Twist
from tams_app.teleop.safety import ArmingState, Reason, Request
from tams_app.units import NS_PER_MS

_FUTURE_NS = 50 * NS_PER_MS  # a time stamp further ahead than this is not believed


@dataclass(frozen=True, slots=True)
class TeleopInput:
    """One tick as the session sees it."""

    now_ns: int
    sample: ControllerSample
    arm: ArmState | None
    link: CommandLink
    arm_ready: bool  # enabled, and nothing has stopped it since
    video_age_ns: int | None  # of the primary view; no frame yet: ENDLESS_NS; None: not judged
    confirm: bool  # edge of Enter or the console's button
    estop: bool  # edge of terminal, console or signal
    faults: tuple[Reason, ...] = ()  # what the session lost or the guard did
    video_damaged: bool = False  # newer frames are shown that do not count: they are not whole


@dataclass(frozen=True, slots=True)
class Refusal:
    """A confirmation that does not count; `in_the_way`: None if only the deadman is held."""

    in_the_way: Reason | None


@dataclass(frozen=True, slots=True)
class TeleopOutput:
    """One tick's commands and what to show."""

    twist: Twist | None  # None: send nothing
    gripper: bool | None  # close (True) or open (False) now
    stop: bool  # stop the arm now; every tick of a fault until the arm reports that it stopped
    request: Request
    arming: ArmingState
    reason: Reason | None
    detail: str  # beside the reason: the arm's fault, the link's failure, what else is lost
    deadman: bool
    orientation_mode: bool
    speed_scale: float  # 1 unless stale video or a singularity slows the arm
    braking: bool  # the stop profile is in force, not the motion profile
    haptic: Haptic | None
    refusal: Refusal | None = None  # of this tick's confirmation
    lasting: Reason | None = None  # `reason`, or what came besides; None: its cause is gone


def is_fresh(stamp_ns: int, now_ns: int, limit_ns: float) -> bool:
    """Whether a time stamp is at most `limit_ns` old, and no more than 50 ms ahead."""
    return -_FUTURE_NS <= now_ns - stamp_ns <= limit_ns
