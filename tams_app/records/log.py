"""What the log keeps besides: ticks, stops, load, sentences, link, trial and episodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, TypeAlias

from tams_app.records.arm import ArmState, CommandLink
from tams_app.records.hand import ControllerSample
from tams_app.records.policy import Phase
from tams_app.records.record import Pose, Record, TimeNs, Twist
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

    @property
    def rest_ms(self) -> float | None:
        """Time from its cause to the arm at rest [ms]; None: the session ended before."""
        return None if self.stopped_ns is None else (self.stopped_ns - self.visible_ns) / NS_PER_MS


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


@dataclass(frozen=True, slots=True)
class SceneTruth(Record):
    """Where things really are (simulated rig only)."""

    t_ns: TimeNs
    block: Annotated[Pose, "where the block is, base frame"]
    container: Annotated[Pose, "where the container is, base frame"]
    tcp: Annotated[Pose, "the tool centre point, base frame"]
    block_speed: Annotated[float, "of the block [m/s]"]
    fingers_opening: Annotated[float, "between the fingers [m]; 0: closed"]


@dataclass(frozen=True, slots=True)
class Placed(Record):
    """The judge of the simulated rig has seen the block placed, or it was put back for another."""

    t_ns: TimeNs
    placed: Annotated[bool, "whether it is placed; false: it was put back"]


@dataclass(frozen=True, slots=True)
class Outcome(Record):
    """The verdict on a trial (docs/GLOSSARY.md, Trial)."""

    completed: Annotated[bool | None, "whether the block was placed in time; null: not judged"]
    success: Annotated[
        bool | None, "whether it was placed well in time with few drops; null: not judged"
    ]
    completion_time_s: Annotated[
        float | None, "from the first engagement to the placing [s]; null: not judged"
    ]
    drops: Annotated[int | None, "of the block; null: not judged"]
    reason: Annotated[str, "why the session ended"]


@dataclass(frozen=True, slots=True)
class OperatorGlance(Record):
    """Which view gave the simulated operator how much in one glance at the screen."""

    t_ns: TimeNs
    stage: Annotated[str, "of the task, as the operator believes"]
    to_block: Annotated[
        dict[str, float],
        "share of each view in what the glance showed of tool to block, sum 1; empty: nothing",
    ]
    to_container: Annotated[
        dict[str, float],
        "share of each view in what the glance showed of tool to container, sum 1; empty: nothing",
    ]
    about_block: Annotated[bool, "whether the stage is about the block, else the container"]
    block_sigma: Annotated[
        float, "how surely tool to block is known after the glance, standard deviation [m]"
    ]
    container_sigma: Annotated[
        float, "how surely tool to container is known after the glance, standard deviation [m]"
    ]
    lag_ns: Annotated[int, "hand to eye, as the operator judges it [ns]"]
    hanging: Annotated[tuple[str, ...], "views in which nothing moves although the hand does"]

    @property
    def relied_on(self) -> dict[str, float]:
        """The shares that counted for what the stage is about."""
        return self.to_block if self.about_block else self.to_container

    @property
    def sigma(self) -> float:
        """How surely the vector to what the stage is about was known [m]."""
        return self.block_sigma if self.about_block else self.container_sigma


class EpisodeRequest(StrEnum):
    """A person's request about episodes; the order is that of the counts in a link's message."""

    NEXT = "next"  # begin one; end the one that is recorded, and keep it
    DISCARD = "discard"
    REDO = "redo"  # discard, and begin the next
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class Episode(Record):
    """An episode that has ended, written then and at each later verdict: the newest counts."""

    t_ns: TimeNs
    number: Annotated[int, "of the episode, from 1 in each session"]
    start_ns: Annotated[int, "when it began [ns]"]
    end_ns: Annotated[int, "when it ended, an instant that is not part of it [ns]"]
    kept: Annotated[bool, "whether it is kept, and not discarded"] = True
    success: Annotated[bool | None, "whether a person called it a success; null: nobody said"] = (
        None
    )
