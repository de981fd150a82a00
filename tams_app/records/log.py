"""What the log keeps besides: ticks, stops, load, sentences, and the link of two computers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from tams_app.records.arm import ArmState, CommandLink
from tams_app.records.geometry import Twist
from tams_app.records.hand import ControllerSample
from tams_app.records.policy import Phase
from tams_app.records.record import Record, TimeNs
from tams_app.units import NS_PER_MS

LATE_NS = NS_PER_MS  # a tick that begins so much after it was due is late


@dataclass(frozen=True, slots=True)
class TickInputs:
    """What a tick received besides hand, arm and link."""

    arm_ready: Annotated[bool, "whether the arm is enabled and nothing has stopped it since"]
    video_age_ns: Annotated[
        int | None, "of the primary view's newest frame that counts [ns]; null: no video"
    ]
    confirm: Annotated[bool, "whether the operator confirmed since the tick before"]
    estop: Annotated[bool, "whether an emergency stop was asked for since the tick before"]
    faults: Annotated[tuple[str, ...], "labels of what the session lost, or the guard did"]
    video_damaged: Annotated[bool, "whether a newer frame is shown that is not whole"] = False


@dataclass(frozen=True, slots=True)
class Tick(Record):
    """One tick of the control loop, as it was seen and as it ended."""

    due_ns: Annotated[int, "when the tick was due [ns]"]
    started_ns: Annotated[int, "when the tick began [ns]"]
    finished_ns: Annotated[int, "when the tick ended [ns]"]
    skipped: Annotated[int, "control periods left out since the start"]
    arming: Annotated[str, "state of the arming table: DISARMED, READY, ENGAGED, HOLDING or FAULT"]
    reason: Annotated[str, "why the arm holds or is in fault; empty: it does not"]
    deadman: Annotated[bool, "whether the trigger counts as pressed"]
    orientation_mode: Annotated[bool, "whether the hand turns the tool instead of moving it"]
    phase: Annotated[Phase, "phase of the task"]
    speed: Annotated[float, "smoothed speed of the TCP [m/s]"]
    vertical_speed: Annotated[float, "smoothed upward speed of the TCP [m/s]"]
    speed_scale: Annotated[
        float, "factor on the speed: 1, less with stale video or near a singularity"
    ]
    twist: Annotated[Twist, "velocity of the TCP as sent to the arm, base frame"]
    controller: Annotated[ControllerSample, "the tracked controller, in the tracking frame"]
    arm: Annotated[ArmState | None, "the arm's last report; null: none yet"]
    link: Annotated[CommandLink, "health of the arm's command connection"]
    gripper: Annotated[
        bool | None, "this tick's command to close (true) or open (false); null: none"
    ] = None
    stop: Annotated[bool, "whether this tick commanded the arm to stop"] = False
    inputs: Annotated[
        TickInputs | None,
        "what the tick received besides hand, arm and link; null: the log does not say",
    ] = None
    lasting: Annotated[
        str | None,
        "label of the reason whose cause is still there; empty: gone; null: not recorded",
    ] = None


@dataclass(frozen=True, slots=True)
class StopRecord(Record):
    """A stop that was not the operator's own release: from the fault seen to the arm at rest."""

    reason: Annotated[str, "what stopped the arm"]
    visible_ns: Annotated[int, "when the cause of the stop showed [ns]"]
    stopped_ns: Annotated[
        int | None, "when the arm reported less than 1 mm/s [ns]; null: the session ended before"
    ]


@dataclass(frozen=True, slots=True)
class SystemSample(Record):
    """Load of the application and of its helper processes."""

    t_ns: TimeNs
    app_cpu_percent: Annotated[float, "processor time of the application [% of a core]"]
    helper_cpu_percent: Annotated[
        dict[str, float], "processor time of each helper process [% of a core]"
    ]
    rss_mb: Annotated[float, "resident memory, application and helpers [MB]"]


@dataclass(frozen=True, slots=True)
class Note(Record):
    """A sentence worth keeping: warnings, what was started, what was refused."""

    t_ns: TimeNs
    level: Annotated[str, "info, warning or error"]
    text: Annotated[str, "the sentence"]


TakeNote: TypeAlias = Callable[[str, str], None]
"""Writes a `Note` into the log: level (info, warning or error) and sentence."""


@dataclass(frozen=True, slots=True)
class HandHeard(Record):
    """A sample of the hand as the robot's side received it."""

    t_ns: TimeNs
    sent_ns: Annotated[int, "when the operator's side sent it, on its own clock [ns]"]
    pose_ns: Annotated[int, "when the value of the pose last changed, on the same clock [ns]"]
    echo_ns: Annotated[int, "newest stamp of this side in the message [ns]"]
    refusal: Annotated[str, "why the sample did not count; empty: it did"]
    operator: Annotated[
        int, "number of the application that sent it, `link_operator` in its own log"
    ]


@dataclass(frozen=True, slots=True)
class StateHeard(Record):
    """A message of the robot's side as the operator's side received it."""

    t_ns: TimeNs
    sent_ns: Annotated[int, "when the robot's side sent it, on its own clock [ns]"]
    echo_ns: Annotated[int, "newest stamp of the operator's side in the message, on its clock [ns]"]


@dataclass(frozen=True, slots=True)
class LinkHealth(Record):
    """How the link stands, as one side sees it."""

    t_ns: TimeNs
    connected: Annotated[bool, "whether messages of the other side arrive"]
    age_bound_ns: Annotated[
        int | None, "what arrived last is no older [ns]; null: nothing has arrived"
    ]
    offset_ns: Annotated[
        int | None, "the other side's clock minus this one's [ns]; null: not known yet"
    ]
    uncertainty_ns: Annotated[int | None, "of the offset [ns]; null: not known yet"]
    refused: Annotated[dict[str, int], "messages that changed nothing since the start, by reason"]
    ignored: Annotated[dict[str, int], "datagrams that changed nothing since the start, by reason"]
