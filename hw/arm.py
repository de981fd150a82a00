"""The interfaces of a robot arm: the driver, its simulation, its kinematics, and its kind.

An arm model is a folder in hw/ with an `ArmKind`, and a word in `hw.arms.ARM_KINDS` that the
configuration names in `arm.model`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tams_app.records import ArmFigure, ArmState, CommandLink, Pose, Twist, Vector
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
        """The newest report, None before the first; does not block."""

    @abstractmethod
    def link(self) -> CommandLink:
        """Health of the command connection; does not block."""

    @abstractmethod
    def send_twist(self, twist: Twist) -> None:
        """Move the TCP until the next command or the end of the deadman time.

        One that is not finite, or beyond the `ArmLimits` of its kind, is not followed: `link` tells
        it as REFUSED, and nothing moves until the arm is enabled again.

        Args:
            twist: of the TCP in the base frame [m/s, rad/s].
        """

    @abstractmethod
    def set_gripper(self, closed: bool) -> None:
        """Close or open the gripper."""

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
        """Leave out what is more than `longest_ns` behind the clock: the process stood still."""


@dataclass(frozen=True, slots=True)
class PlantState:
    """Measured joints [rad], and whether a joint met more force than it may."""

    joints: Joints
    collision: bool


class Plant(Protocol):
    """Joints and gripper of a simulated arm; its controller calls `step` once per cycle."""

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        """Advance by `duration_ns` towards `joints_target` [rad].

        `closing`: whether the gripper is driven closed or open; None: not driven.
        """


class ArmKinematics(Protocol):
    """The kinematics of an arm with its configured tool; base frame with z up."""

    @property
    def joint_speed_limits(self) -> Vector:
        """Largest joint speeds [rad/s], shape (6,)."""

    def tcp_pose(self, joints: Vector) -> Pose:
        """The TCP in the base frame [m], for `joints` [rad], shape (6,)."""

    def jacobian(self, joints: Vector) -> NDArray[np.float64]:
        """Joint speeds [rad/s] to the TCP's twist (vx, vy, vz, wx, wy, wz), shape (6, 6)."""


@dataclass(frozen=True, slots=True)
class ArmLimits:
    """What an arm can do at most, after its maker's manual; the configuration must stay within."""

    joint_lower_deg: tuple[float, ...]  # six
    joint_upper_deg: tuple[float, ...]
    joint_speed_rad_s: float  # of every joint
    tcp_speed_mm_s: float
    tcp_acceleration_mm_s2: float
    reach_mm: float  # of the flange, from the base axis
    shoulder_mm: float  # height above the base
    stretched_mm: float  # from the shoulder to the flange of the stretched arm


@dataclass(frozen=True, slots=True)
class TcpBoundary:
    """A box that the TCP must not leave, in the base frame, in whole millimetres: x, y, z."""

    lower_mm: tuple[int, int, int]
    upper_mm: tuple[int, int, int]

    def contains(self, position: Numbers) -> bool:
        """Whether `position` [m], shape (3,), is inside."""
        return all(
            low <= value * 1000.0 <= high
            for value, low, high in zip(position, self.lower_mm, self.upper_mm, strict=True)
        )


class StopChannel(Protocol):
    """A connection of its own that does nothing but stop the arm, for the guard process.

    Made with host, port, reply time-out [s] and the name of its thread.
    """

    @property
    def failure(self) -> str:
        """Why a stop would not get through at the moment, in one sentence; "" if it would."""

    @property
    def pending(self) -> bool:
        """A stop was asked for and is not acknowledged yet."""

    def start(self) -> None:
        """Connect; DeviceError if the arm does not answer."""

    def request_stop(self) -> None:
        """Stop the arm, repeated until acknowledged; does not block, from any thread."""

    def wait_acknowledged(self, timeout_s: float) -> bool:
        """Wait until every stop asked for is acknowledged; False after `timeout_s`."""

    def close(self) -> None:
        """Disconnect; may be called twice."""


@dataclass(frozen=True, slots=True)
class FoundArm:
    """What answers at an arm's address."""

    problem: str  # why it cannot be used, in one sentence; "" if it can
    description: str  # what it is, in one line


class ArmKind(ABC):
    """One model of arm: its limits, and the makers of all that belongs to it."""

    title: str  # as its maker calls it
    limits: ArmLimits
    stop_channel: str  # "module:name" of the `StopChannel`, which the guard process loads
    report_watch: str  # "module:name" of the `hw.arm_report.ReportWatch`, which it loads as well
    simulation: str  # "module:name" of the maker that `hw.arms.simulated_arm` calls
    rig: str = ""  # module of the helper process that simulates arm and scene; "": there is none

    @abstractmethod
    def make_arm(
        self,
        config: ArmConfig,
        clock: Clock,
        control_rate_hz: float,
        boundary: TcpBoundary | None,
    ) -> Arm:
        """The driver of the arm at `config.host`, not connected yet.

        Args:
            clock: which stamps the reports.
            control_rate_hz: a reply that takes longer than one period counts as slow.
            boundary: set in the controller on connecting; None leaves the controller's as it is.
        """

    @abstractmethod
    def kinematics(self, config: ArmConfig) -> ArmKinematics:
        """The kinematics with the configured tool."""

    def figure(self) -> ArmFigure | None:
        """How the arm looks, for viewers of the log; None: they are shown its TCP alone."""
        return None

    @abstractmethod
    def find(self, config: ArmConfig) -> FoundArm:
        """Look what answers at `config.host`, without moving, stopping or changing it."""
