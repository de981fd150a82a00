"""The interfaces of a robot arm: the driver, its simulation, and its kind.

An arm model is a folder in hw/ with an `ArmKind`, and a word in `hw.arms.ARM_KINDS` that the
configuration names in `arm.model`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from tams_app.records import ArmFigure, ArmKinematics, ArmState, CommandLink, Twist
from tams_app.vectors import Joints, Numbers

if TYPE_CHECKING:
    from tams_app.config import ArmConfig
    from tams_app.runtime.clock import Clock


class Arm(ABC):
    """A driver of a six-joint arm with a two-finger gripper.

    `send_*` and `set_gripper` hand the newest command to the wire and return at once: the control
    loop never waits for a reply. What became of it shows in `link()` and in `state()`.
    Everything else may block for up to its time-out and is called outside the control loop.
    """

    @abstractmethod
    def connect(self) -> None:
        """Connect, stop the arm and set it up; the brakes stay as they are.

        Raises:
            DeviceError: it is not there, not fit to be used, or in an error. After an error of its
                controller the connection stays, for `clear_errors` and another `connect`.
        """

    @abstractmethod
    def enable(self) -> None:
        """Release the brakes and enter the velocity servo; the arm does not move by this.

        Raises:
            DeviceError: not connected, in an error, refused, or stopped meanwhile.
        """

    @abstractmethod
    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        """Release the brakes and begin to move to a pose, for reaching the ready pose.

        Where the arm is shows in `state()`; `stop` ends the move, and no servo is enabled
        afterwards.

        Args:
            joints: six joint angles [rad].
            speed: of the fastest joint [rad/s].

        Raises:
            DeviceError: outside the arm's limits, or as `enable`.
        """

    @abstractmethod
    def state(self) -> ArmState | None:
        """The newest report of the controller; does not block.

        Returns:
            Joints [rad], shape (6,), TCP in the base frame [m], activity, fault and when it was
            received [ns]; None before the first report and after `close`.
        """

    @abstractmethod
    def link(self) -> CommandLink:
        """Health of the command connection; does not block.

        Returns:
            How many commands were sent, their last round trip [ns], and the fault with its sentence
            ("" while there is none); LOST before `connect`.
        """

    @abstractmethod
    def send_twist(self, twist: Twist) -> None:
        """Move the TCP until the next command or the end of the deadman time.

        One that is not finite, or beyond the `ArmLimits` of its kind, is not followed: `link`
        reports it as REFUSED, and nothing moves until the arm is enabled again.

        Args:
            twist: of the TCP in the base frame [m/s, rad/s].
        """

    @abstractmethod
    def set_gripper(self, closed: bool) -> None:
        """Close or open the gripper; without effect while the arm is stopped.

        Args:
            closed: True to close, False to open.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop now, over a connection of its own, repeated until acknowledged.

        Does not block; may be called from any thread and any number of times.
        """

    @abstractmethod
    def clear_errors(self) -> None:
        """Clear the controller's error with the operator's consent; the arm stays stopped.

        A lost connection is made anew, with all checks and settings.

        Raises:
            DeviceError: the error persists, or the connection cannot be made.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop the arm and disconnect; may be called twice.

        Raises:
            DeviceError: all is closed, but the arm did not acknowledge the stop.
        """

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the control loop and the arm, by name."""
        return {}


class SimulatedArm(Arm):
    """An arm whose controller lives in this process, brought up to the clock by every call."""

    @property
    @abstractmethod
    def simulated_ns(self) -> int:
        """The instant [ns] that the arm and its plant stand at."""

    @abstractmethod
    def skip_standstill(self, longest_ns: int) -> None:
        """Skip simulated time after the process stood still.

        Args:
            longest_ns: how far the simulation may stay behind the clock [ns]; what is older is
                left out.
        """


@dataclass(frozen=True, slots=True)
class PlantState:
    """A simulated arm after one step: six joint angles [rad], as measured.

    collision: a joint met more force than it may.
    """

    joints: Joints
    collision: bool


class Plant(Protocol):
    """Joints and gripper of a simulated arm; its controller calls `step` once per cycle."""

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        """Advance by one cycle of the controller.

        Args:
            joints_target: six joint angles [rad] to be reached at the end of the cycle.
            closing: True drives the gripper closed, False open; None: it is not driven.
            duration_ns: length of the cycle [ns], positive.

        Returns:
            The state at the end of the cycle.
        """


@dataclass(frozen=True, slots=True)
class ArmLimits:
    """The largest ranges and speeds of an arm, from its maker's manual.

    The configuration must stay within them. Ranges are of each of six joints, the speed of every
    one. reach_mm: of the flange, from the base axis. shoulder_mm: its height above the base.
    stretched_mm: from there to the flange of the stretched arm. hot_motor_c: from this temperature
    of a joint's motor on the operator is warned.
    """

    joint_lower_deg: tuple[float, ...]
    joint_upper_deg: tuple[float, ...]
    joint_speed_rad_s: float
    tcp_speed_mm_s: float
    tcp_acceleration_mm_s2: float
    reach_mm: float
    shoulder_mm: float
    stretched_mm: float
    hot_motor_c: float = math.inf


@dataclass(frozen=True, slots=True)
class TcpBoundary:
    """A box in the base frame that the TCP must not leave: its least and greatest x, y and z."""

    lower_mm: tuple[int, int, int]
    upper_mm: tuple[int, int, int]

    def contains(self, position: Numbers) -> bool:
        """Test whether a position is inside, its faces included.

        Args:
            position: in the base frame [m], shape (3,).

        Returns:
            True if it is.
        """
        return all(
            low <= value * 1000.0 <= high
            for value, low, high in zip(position, self.lower_mm, self.upper_mm, strict=True)
        )


class StopChannel(Protocol):
    """A connection of its own that does nothing but stop the arm, for the guard process.

    It is made with host, port, reply time-out [s] and, by keyword, the `name` of its thread.
    """

    @property
    def failure(self) -> str:
        """The cause that keeps a stop from getting through now, in one sentence; "" if none."""

    @property
    def pending(self) -> bool:
        """True while a stop that was requested is not acknowledged."""

    def start(self) -> None:
        """Connect.

        Raises:
            DeviceError: the arm does not answer.
        """

    def request_stop(self) -> None:
        """Stop the arm, repeated until acknowledged; does not block, from any thread."""

    def wait_acknowledged(self, timeout_s: float) -> bool:
        """Wait until every stop that was requested is acknowledged.

        Args:
            timeout_s: how long at most [s].

        Returns:
            False if the time has passed before.
        """

    def close(self) -> None:
        """Disconnect; may be called twice."""


@dataclass(frozen=True, slots=True)
class FoundArm:
    """What answers at an arm's address: why it cannot be used, a sentence, or ""; what it is."""

    problem: str
    description: str


class ArmKind(ABC):
    """One model of arm: its limits, and the makers of all that belongs to it."""

    title: str
    """The maker's name for the model."""
    limits: ArmLimits
    """The bounds that configuration and commands are checked against."""
    stop_channel: str
    """"module:name" of the `StopChannel`, which the guard process loads."""
    report_watch: str
    """"module:name" of the `hw.arm_report.ReportWatch`, which the guard process loads as well."""
    simulation: str
    """"module:name" of the maker of a `SimulatedArm`, with the arguments of
    `hw.arms.simulated_arm`."""
    rig: str = ""
    """Module of the helper process that simulates arm and scene; "": there is none."""

    @abstractmethod
    def make_arm(
        self,
        config: ArmConfig,
        clock: Clock,
        control_rate_hz: float,
        boundary: TcpBoundary | None,
    ) -> Arm:
        """Make the driver of the arm at `config.host`.

        Args:
            config: `arm` of the configuration.
            clock: stamps the reports.
            control_rate_hz: of the control loop [Hz]; a reply that takes longer than one period
                counts as slow.
            boundary: set in the controller on connecting; None leaves the controller's as it is.

        Returns:
            A driver, not connected yet.
        """

    @abstractmethod
    def kinematics(self, config: ArmConfig) -> ArmKinematics:
        """Make the kinematics with the configured tool.

        Args:
            config: `arm` of the configuration; `tcp_offset_mm_deg` is the tool.

        Returns:
            Forward kinematics and Jacobian of flange and tool.
        """

    def figure(self) -> ArmFigure | None:
        """Make the shape of the arm, for viewers of the log.

        Returns:
            Solids of its links and how joints place them; None: viewers show the TCP alone.
        """
        return None

    @abstractmethod
    def find(self, config: ArmConfig) -> FoundArm:
        """Look up what answers at `config.host`, for `doctor`; it neither moves nor changes it.

        Args:
            config: `arm` of the configuration.

        Returns:
            A description, and the problem if the arm cannot be used.
        """
