"""The interface of a robot arm that follows Cartesian commands of its tool centre point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import StrEnum

from tams_app.records import ArmState, CommandLink, Pose, Twist


class ServoMode(StrEnum):
    """How the arm is moved."""

    VELOCITY = "velocity"  # twists with a deadman time in the controller
    POSE = "pose"  # small absolute steps


class Arm(ABC):
    """A six-joint arm with a two-finger gripper.

    `send_*` and `set_gripper` hand the newest command to the wire and return at once: the control
    loop never waits for a reply. What became of it shows in `link()` and in `state()`.
    Everything else may block for up to its time-out and is called outside the control loop.
    """

    @abstractmethod
    def connect(self) -> None:
        """Connect and check that the arm is fit to be used; DeviceError says what is not."""

    @abstractmethod
    def enable(self, servo: ServoMode) -> None:
        """Release the brakes and enter the servo mode; the arm does not move by this."""

    @abstractmethod
    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        """Release the brakes and begin to move to `joints` [rad] at `speed` [rad/s].

        For reaching the ready pose. Where the arm is shows in `state()`; `stop` ends the move, and
        no servo is enabled afterwards.
        """

    @abstractmethod
    def state(self) -> ArmState | None:
        """The newest report, None before the first; does not block."""

    @abstractmethod
    def link(self) -> CommandLink:
        """Health of the command connection; does not block."""

    @abstractmethod
    def send_twist(self, twist: Twist) -> None:
        """Velocity servo: move the TCP with `twist` until the next command or the deadman time."""

    @abstractmethod
    def send_pose(self, pose: Pose) -> None:
        """Pose servo: move the TCP to `pose`, at most 10 mm away."""

    @abstractmethod
    def set_gripper(self, closed: bool) -> None:
        """Close or open the gripper."""

    @abstractmethod
    def stop(self) -> None:
        """Stop now (controller state 4) over a connection of its own, repeated until acknowledged.

        Does not block; may be called from any thread and any number of times.
        """

    @abstractmethod
    def clear_errors(self) -> None:
        """Clear the controller's error with the operator's consent; the arm stays stopped.

        A lost connection is made anew, with all checks and settings. DeviceError if it persists.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop the arm and disconnect; may be called twice."""

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the control loop and the arm, by name."""
        return {}
