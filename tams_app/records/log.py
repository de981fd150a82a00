"""What the log keeps besides: ticks, stops, load and sentences."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.records.arm import ArmState, CommandLink
from tams_app.records.geometry import Twist
from tams_app.records.hand import ControllerSample
from tams_app.records.policy import Phase


@dataclass(frozen=True, slots=True)
class TickInputs:
    """What a tick was told besides hand, arm and link."""

    arm_ready: bool
    video_age_ns: int | None
    confirm: bool
    estop: bool
    faults: tuple[str, ...]  # labels of what the session lost or the guard did
    video_damaged: bool = False


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of the control loop, as it was seen and as it ended."""

    due_ns: int
    started_ns: int
    finished_ns: int
    skipped: int  # periods left out since the loop began
    arming: str
    reason: str  # why the arm holds or is in fault, "" otherwise
    deadman: bool
    orientation_mode: bool
    phase: Phase
    speed: float  # smoothed TCP speed v̄ [m/s]
    vertical_speed: float  # smoothed v̄_z [m/s]
    speed_scale: float  # 1 unless stale video or a singularity slows the arm
    twist: Twist  # as sent
    controller: ControllerSample
    arm: ArmState | None
    link: CommandLink
    gripper: bool | None = None  # told to close (True) or open (False) by this tick
    stop: bool = False  # this tick told the arm to stop
    inputs: TickInputs | None = None  # None: the log is of schema 3 or older
    lasting: str | None = None  # what of `reason` is still there, "" nothing; None: not recorded


@dataclass(frozen=True, slots=True)
class StopRecord:
    """A stop that was not the operator's own release: from the fault seen to the arm at rest."""

    reason: str
    visible_ns: int
    stopped_ns: int | None  # reported TCP speed < 1 mm/s; None if the session ended before


@dataclass(frozen=True, slots=True)
class SystemSample:
    """Load of the application and of its helper processes (percent of one core)."""

    t_ns: int
    app_cpu_percent: float
    helper_cpu_percent: dict[str, float]
    rss_mb: float  # application and helpers together


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence worth keeping: warnings, what was started, what was refused."""

    t_ns: int
    level: str  # info, warning or error
    text: str
