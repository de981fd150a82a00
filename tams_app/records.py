"""The plain frozen records that flow between the packages.

Units inside TAMS: metres, radians, seconds; `*_ns` are integer nanoseconds of one monotonic clock,
taken where the thing happened; `*_kbps` are kbit/s of IP datagram bytes (RTP packet + 28).
Vectors are float64 arrays of shape (3,), joints of shape (6,); what a tick computes with is plain
floats (`Floats3`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Vector: TypeAlias = NDArray[np.float64]
Image: TypeAlias = NDArray[np.uint8]

IP_UDP_HEADER_BYTES = 28  # IPv4 (20) + UDP (8)


@dataclass(frozen=True, slots=True)
class Pose:
    """Position [m], shape (3,), and rotation of a frame in its parent frame."""

    position: Vector
    rotation: Rotation


@dataclass(frozen=True, slots=True)
class Twist:
    """Linear [m/s] and angular [rad/s] velocity in the arm's base frame."""

    linear: Floats3
    angular: Floats3

    @staticmethod
    def zero() -> Twist:
        return Twist(ZERO, ZERO)

    @property
    def is_zero(self) -> bool:
        return not (any(self.linear) or any(self.angular))


# --- the operator's hand ------------------------------------------------------------------------


class ControllerStatus(StrEnum):
    """What the tracking runtime says of the controller; anything but OK reads as released."""

    OK = "ok"
    DISCONNECTED = "disconnected"
    TRACKING_LOST = "tracking lost"
    STANDBY = "standby"
    DASHBOARD = "dashboard open"
    RUNTIME_QUIT = "runtime quit"
    ROLE_SWAPPED = "role swapped"  # another device plays the operator's hand now
    TRACKING_FRAME_CHANGED = "tracking frame changed"  # recentred: directions may have turned
    LINK_LOST = "link lost"  # to the computer that has the controller


@dataclass(frozen=True, slots=True)
class ControllerSample:
    """One reading of the tracked controller, in the tracking frame (OpenVR: y up, right-handed).

    `pose` is None when the runtime calls it invalid. `pose_ns`: when the pose's value last
    changed; `buttons_ns`: the last successful, active read of the buttons.
    """

    status: ControllerStatus
    pose: Pose | None
    pose_ns: int
    buttons_ns: int
    trigger: float  # 0..1, deadman and clutch
    grip: float  # 0..1, toggles translation/orientation on its edge
    a: bool  # closes the gripper on its edge
    b: bool  # opens the gripper on its edge
    menu: bool  # held 1 s: confirm; clicked: emergency stop


class Haptic(StrEnum):
    """The pulses the operator feels."""

    ENGAGE = "engage"
    RELEASE = "release"
    LIMIT = "limit"
    FAULT = "fault"


# --- the arm ------------------------------------------------------------------------------------


class ServoMode(StrEnum):
    """How an arm is moved by the control loop."""

    VELOCITY = "velocity"  # twists with a deadman time in the controller
    POSE = "pose"  # small absolute steps


class Activity(StrEnum):
    """What the arm's controller says that the arm is doing."""

    MOVING = "moving"
    IDLE = "idle"  # stands, and takes motion commands
    PAUSED = "paused"
    STOPPED = "stopped"  # takes no motion command until it is enabled

    @property
    def is_halted(self) -> bool:
        """Whether motion commands are not followed."""
        return self in (Activity.PAUSED, Activity.STOPPED)


@dataclass(frozen=True, slots=True)
class ArmFault:
    """An error that the arm's controller reports.

    code: the controller's own number, never 0.
    text: a clause without a full stop: the number as the manual prints it, what it means and what
        to do about it, such as "C31 (collision): remove what it hit".
    """

    code: int
    text: str

    @property
    def sentence(self) -> str:
        """The fault in one sentence."""
        return f"The arm stopped with error {self.text}."


@dataclass(frozen=True, slots=True)
class ArmState:
    """The arm's last report, in the words that all arms share.

    received_ns: when it arrived [ns], monotonic clock.
    joints: joint angles [rad], shape (6,).
    tcp: the tool centre point in the base frame (z up) [m].
    servo: the servo mode that the controller is in; None in any other mode.
    fault: what the controller reports, None if it has no error.
    gripper_closed: the last command that was acknowledged (nothing senses the fingers); None
        until one was read back or sent.
    warning_code: the controller's own number, kept in the log; 0 for none.
    """

    received_ns: int
    joints: Vector
    tcp: Pose
    activity: Activity
    servo: ServoMode | None
    fault: ArmFault | None
    gripper_closed: bool | None
    warning_code: int = 0


class LinkFault(StrEnum):
    """What kind of failure ended the arm's command link."""

    NONE = ""
    LOST = "lost"  # nothing gets through
    REFUSED = "refused"  # the arm answers, and refuses
    GRIPPER = "gripper"  # the tool's outputs do not do what was commanded


@dataclass(frozen=True, slots=True)
class CommandLink:
    """Health of the arm's command connection, as its sender sees it."""

    sent: int  # commands handed to the wire
    acknowledged_ns: int  # when the last reply arrived
    round_trip_ns: int  # of the last acknowledged command
    slow: int  # replies later than one control period
    failure: str  # "" or one sentence: why commands no longer get through
    fault: LinkFault = LinkFault.NONE  # NONE exactly when `failure` is ""


# --- policy -------------------------------------------------------------------------------------


class Phase(StrEnum):
    """The six phases of the pick-and-place task (paper, section II)."""

    REACH = "REACH"
    ALIGN = "ALIGN"
    GRASP = "GRASP"
    TRANSPORT = "TRANSPORT"
    PRE_RELEASE = "PRE_RELEASE"
    RELEASE = "RELEASE"


@dataclass(frozen=True, slots=True)
class PhaseChange:
    """A phase began; `reason` says which line of Algorithm 1 decided."""

    t_ns: int
    phase: Phase
    reason: str


@dataclass(frozen=True, slots=True)
class Allocation:
    """What the policy asked of the encoders at one instant."""

    t_ns: int
    phase: Phase
    capacity_kbps: float  # what the budget source believes the uplink carries
    budget_kbps: float  # B: capacity after the safety factor
    target_kbps: dict[str, int]  # per view; the sum never exceeds B


# --- video --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Frame:
    """A captured frame: BGR, shape (height, width, 3); `index` counts captures of its view."""

    view: str
    index: int
    capture_ns: int
    image: Image


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """A frame as it left the encoder: H.264 Annex B bytes of one access unit."""

    view: str
    index: int
    capture_ns: int
    encoded_ns: int
    keyframe: bool
    data: bytes
    pushed_ns: int = 0  # handed to the sender; 0 in logs that do not say
    rtp_timestamp: int | None = None  # of its packets; None in logs that do not say


@dataclass(frozen=True, slots=True)
class CameraRates:
    """How many frames a second the cameras gave lately, and what is asked of them from now on."""

    t_ns: int
    asked_fps: float  # less than the header's `fps` while the rig's cameras are stepped down
    reason: str  # why `asked_fps` is another one from now on, "" if it is not
    given_fps: dict[str, float]  # by view, over the last second; empty in the first record
    overrun_fps: dict[
        str, float
    ]  # frames that a camera had besides, which the session did not take


@dataclass(frozen=True, slots=True)
class DroppedFrame:
    """A captured frame that was left out at the source because its target was below 80 kbit/s."""

    view: str
    index: int
    capture_ns: int
    under_way: bool = False  # because too much was on its way over the link, instead


@dataclass(frozen=True, slots=True)
class ShownFrame:
    """A decoded frame that reached the receiver's mailbox: BGR, shape (height, width, 3)."""

    view: str
    index: int  # capture index, exact also under loss
    shown_ns: int
    image: Image
    capture_ns: int


@dataclass(frozen=True, slots=True)
class FrameQuality:
    """What became of one captured frame. Scores are SSIM, None where they were not computed.

    `age_ns`: of what was on screen when it was captured (None: nothing, or not known);
    `frozen`: that frame stayed too long (`freeze_ns`); `concealed`: the decoder filled
    in for lost data, None where this is not known live.
    """

    view: str
    index: int
    capture_ns: int
    shown_ns: int | None  # None: never shown
    age_ns: int | None
    frozen: bool
    concealed: bool | None
    received: float | None  # the frame as shown against itself as captured
    delivered: float | None  # what stands for it: itself, or the frame shown before it
    live: float | None  # what was on screen when it was captured, against it


class PacketKind(Enum):
    """What an uplink datagram carried."""

    MEDIA = 0
    REPAIR = 1
    RTCP = 2
    PARITY = 3
    PADDING = 4


class PacketFate(Enum):
    """What became of a datagram at the link."""

    DELIVERED = 0
    OVERFLOW = 1  # tail drop at the bottleneck queue
    LOST = 2


@dataclass(frozen=True, slots=True)
class PacketRecord:
    """One datagram's way through the link; `size_bytes` includes IP and UDP headers."""

    view: str
    kind: PacketKind
    # RTP sequence of the media packet carried; REPAIR: the original's; PARITY: that of the first
    # packet protected; RTCP, PADDING: 0
    sequence: int
    size_bytes: int
    entered_ns: int
    departed_ns: int  # left the bottleneck; 0 if it overflowed
    delivered_ns: int  # 0 if it was not delivered
    fate: PacketFate
    rtp_timestamp: int = 0  # 90 kHz, that of its `EncodedFrame`; 0 for RTCP and padding


@dataclass(frozen=True, slots=True)
class PacketArrival:
    """What a receiver told of one packet of the RTP flow."""

    view: str
    sent_ns: int  # entered the uplink, on the sender's clock
    size_bytes: int  # IP datagram
    arrived_ns: int | None  # on the receiver's clock, of unknown offset; None: it did not arrive


@dataclass(frozen=True, slots=True)
class Reception:
    """A report block of a receiver (RFC 3550, 6.4.1)."""

    view: str
    fraction_lost: float  # since the report before
    round_trip_ns: int | None  # None: not known yet
    jitter_ns: int


@dataclass(frozen=True, slots=True)
class UplinkReport:
    """What the senders know of the uplink at one instant.

    `arrivals` and `receptions` came since the report before; arrivals are those of all views in the
    order of sending, each packet once. Each view's receiver tells when a frame has come: packets of
    one view may be told after later ones of another, in the next report. What is told in feedback
    that does not come is told no more.
    """

    now_ns: int
    sent_bytes: int  # IP datagrams of all views since the start, repair and padding included
    arrivals: tuple[PacketArrival, ...] = ()
    receptions: tuple[Reception, ...] = ()


@dataclass(frozen=True, slots=True)
class UplinkSummary:
    """What one `UplinkReport` told the budget, all views together, as the log keeps it."""

    t_ns: int
    sent_bytes: int  # since the start
    packets: int  # that receivers told of
    lost: int  # of these
    arrived_bytes: int
    # of the packet sent last of those that arrived: sent_ns, and how much longer than the
    # fastest so far it took; None: none arrived
    newest_sent_ns: int | None
    queueing_ns: int | None
    fraction_lost: dict[str, float]  # by view, of the receptions
    round_trip_ns: dict[str, int | None]


@dataclass(frozen=True, slots=True)
class LinkCapacity:
    """What the uplink truly carries from `t_ns` on; infinite where there is no bottleneck."""

    t_ns: int
    capacity_kbps: float


# --- the trial ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SceneTruth:
    """Where things really are (simulated rig only), in the arm's base frame."""

    t_ns: int
    block: Pose
    container: Pose
    tcp: Pose
    block_speed: float  # [m/s]
    fingers_opening: float  # [m], 0 closed


@dataclass(frozen=True, slots=True)
class Outcome:
    """The verdict on a trial (docs/GLOSSARY.md, Trial); None where it was not judged."""

    completed: bool | None
    success: bool | None
    completion_time_s: float | None
    drops: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class OperatorGlance:
    """Which view told the simulated operator how much in one glance at the screen.

    Shares of what the glance added to knowing the vector from tool to block and from tool to
    container: by view, summing to 1; empty when the glance told nothing.
    """

    t_ns: int
    stage: str  # of the task, as the operator believes
    to_block: dict[str, float]
    to_container: dict[str, float]
    about_block: bool  # what the stage is about: the block, else the container
    block_sigma: float  # [m], after the glance
    container_sigma: float  # [m]
    lag_ns: int  # hand to eye, as the operator judges it
    hanging: tuple[str, ...]  # views in which nothing moves although the hand does

    @property
    def relied_on(self) -> dict[str, float]:
        """The shares that counted for what the stage is about."""
        return self.to_block if self.about_block else self.to_container

    @property
    def sigma(self) -> float:
        """How surely the vector to what the stage is about was known [m]."""
        return self.block_sigma if self.about_block else self.container_sigma


# --- the link between two computers -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class HandHeard:
    """A sample of the hand as the robot's side heard it.

    t_ns, echo_ns: on the robot's clock; sent_ns, pose_ns: on that of the operator's side.
    refusal: why it did not count, "" if it did.
    """

    t_ns: int
    sent_ns: int
    pose_ns: int
    echo_ns: int
    refusal: str


@dataclass(frozen=True, slots=True)
class StateHeard:
    """A message of the robot's side as the operator's side heard it.

    t_ns, echo_ns: on the clock of the operator's side; sent_ns: on the robot's.
    """

    t_ns: int
    sent_ns: int
    echo_ns: int


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """How the link stands, as one side sees it.

    age_bound_ns: what was heard last is no older. offset_ns: the other side's clock minus ours,
    with its uncertainty; None before the first exchange. refused, ignored: messages and datagrams
    that changed nothing, by reason, since the start.
    """

    t_ns: int
    connected: bool
    age_bound_ns: int | None
    offset_ns: int | None
    uncertainty_ns: int | None
    refused: dict[str, int]
    ignored: dict[str, int]


# --- what the log keeps besides -----------------------------------------------------------------


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
