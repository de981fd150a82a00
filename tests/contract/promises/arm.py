"""The contract of every arm.

On a real arm these are real moves, without deadman or guard: they need half a metre of free space
around it, and a hand on the emergency stop.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import numpy as np

from hw.arm import Arm, ArmLimits
from tams_app.config.motion import ControlConfig
from tams_app.records import Activity, ArmState, LinkFault, Pose, Twist, Vector
from tests.contract.promises.promise import Promise, refused, require

CONTROL_RATE_HZ = ControlConfig().rate_hz
SIDEWAYS = Twist((0.0, 0.05, 0.0), (0.0, 0.0, 0.0))
_WITHIN_S = 10.0  # generous: the machine may be busy
_WINDOWS = 5  # of a speed: the median counts
_MOVED_MM = 1.0
_BEYOND = 1.2  # times what it can do
_TURN_RAD_S = 0.4


class ArmBench(ABC):
    """An arm that stands at its ready pose, and a way to let time pass."""

    limits: ArmLimits
    """Its largest ranges and speeds; 1.2 times as much is commanded and must be refused."""
    ready_joints: Vector
    """Joint angles [rad] at the beginning, shape (6,)."""
    deadman_s: float
    """How long a twist counts without another [s]."""
    still_mm: float = 0.1
    """How far the TCP of an arm that stands still may seem to move [mm]."""
    still_rad: float = 1e-3
    """The same of a joint [rad]."""

    @abstractmethod
    def make_arm(self) -> Arm:
        """A driver of the arm, not connected; the caller closes it."""

    @abstractmethod
    def advance(self, seconds: float) -> None:
        """Let time [s] pass for the arm: sleep, or advance a simulation."""

    @abstractmethod
    def elapsed_s(self) -> float:
        """The time that `advance` has let pass [s], from any start."""

    def until(self, condition: Callable[[], bool]) -> bool:
        """Let time pass until a condition, checked every 10 ms, holds; False if not within 10 s."""
        deadline_s = self.elapsed_s() + _WITHIN_S
        while self.elapsed_s() < deadline_s:
            if condition():
                return True
            self.advance(0.01)
        return False

    def next_state(self, arm: Arm, reports: int = 2) -> ArmState:
        """The newest report, after so many from now on: the first may have been on its way.

        AssertionError if none comes within 10 s.
        """
        for _ in range(reports):
            before = arm.state()
            received_ns = before.received_ns if before else 0
            newer = self.until(lambda t_ns=received_ns: _received_ns(arm) > t_ns)  # type: ignore[misc]
            require(newer, "the arm's reports have stopped")
        state = arm.state()
        assert state is not None
        return state

    def stream(self, arm: Arm, twist: Twist, seconds: float) -> None:
        """Send a twist to an enabled arm like a control loop, 120 times a second."""
        for _ in range(round(seconds * CONTROL_RATE_HZ)):
            arm.send_twist(twist)
            self.advance(1.0 / CONTROL_RATE_HZ)


def distance_mm(first: Pose, second: Pose) -> float:
    """The distance between two places of the TCP."""
    return float(np.linalg.norm(first.position - second.position)) * 1000.0


def _received_ns(arm: Arm) -> int:
    state = arm.state()
    return 0 if state is None else state.received_ns


@contextmanager
def _under(bench: ArmBench, connect: bool = True, enable: bool = True) -> Iterator[Arm]:
    """A driver as a promise needs it; it is closed, whatever fails."""
    with closing(bench.make_arm()) as arm:
        if connect:
            arm.connect()
            if enable:
                arm.enable()
        yield arm


def _moves(bench: ArmBench, arm: Arm, before: Pose, seconds: float = 0.2) -> None:
    bench.stream(arm, SIDEWAYS, seconds)
    moved_mm = distance_mm(before, bench.next_state(arm).tcp)
    require(moved_mm > _MOVED_MM, f"it has moved by {moved_mm:.3f} mm only")


def _stands(bench: ArmBench, arm: Arm, before: Pose) -> None:
    moved_mm = distance_mm(before, bench.next_state(arm).tcp)
    require(moved_mm < bench.still_mm, f"it has moved by {moved_mm:.3f} mm")


def before_connecting_nothing_moves_and_nothing_breaks(bench: ArmBench) -> None:
    with _under(bench, connect=False) as arm:
        arm.send_twist(SIDEWAYS)
        arm.set_gripper(True)
        arm.stop()
        require(arm.state() is None, "it reports a state")
        link = arm.link()
        require(link.failure != "", "its link says nothing")
        require(link.fault is LinkFault.LOST, f"its link's fault is {link.fault}")
        refused(arm.enable)


def connecting_leaves_the_arm_stopped_where_it_is(bench: ArmBench) -> None:
    with _under(bench, enable=False) as arm:
        state, link = bench.next_state(arm), arm.link()
        require(state.activity is Activity.STOPPED, f"it is {state.activity}")
        require(state.fault is None, f"it has a fault: {state.fault}")
        off = float(np.abs(state.joints - bench.ready_joints).max())
        require(off < bench.still_rad, f"its joints have moved by {off:.2g} rad")
        require(link.failure == "" and link.fault is LinkFault.NONE, f"its link says {link}")


def closing_twice_is_fine_and_one_may_connect_again(bench: ArmBench) -> None:
    with _under(bench) as arm:
        bench.stream(arm, SIDEWAYS, 0.1)
        arm.close()
        arm.close()
        require(arm.state() is None, "it reports a state after it was closed")
        arm.connect()
        arm.enable()
        _moves(bench, arm, bench.next_state(arm).tcp)


def enabling_does_not_move_the_arm(bench: ArmBench) -> None:
    with _under(bench, enable=False) as arm:
        before = bench.next_state(arm).tcp
        for _ in range(2):
            arm.enable()
            bench.advance(0.05)
        _stands(bench, arm, before)


def a_twist_moves_the_tcp_with_its_velocity(bench: ArmBench) -> None:
    with _under(bench) as arm:
        bench.stream(arm, SIDEWAYS, 0.2)
        sent, velocities = arm.link().sent, []
        for _ in range(_WINDOWS):
            first = bench.next_state(arm, reports=0)
            bench.stream(arm, SIDEWAYS, 0.5)
            second = bench.next_state(arm, reports=0)
            seconds = (second.received_ns - first.received_ns) / 1e9
            velocities.append((second.tcp.position - first.tcp.position) / seconds)
        off = np.median(velocities, axis=0) - SIDEWAYS.linear
        require(float(np.abs(off).max()) < 0.015, f"its velocity is off by {off} m/s")
        require(abs(off[0]) < 1e-3 and abs(off[2]) < 1e-3, f"it goes elsewhere, by {off} m/s")
        require(arm.link().failure == "", arm.link().failure)
        require(arm.link().sent > sent, "its link counts no commands")


def a_twist_turns_the_tcp_about_its_axis_in_the_base_frame(bench: ArmBench) -> None:
    with _under(bench) as arm:
        before, begun_s = bench.next_state(arm).tcp, bench.elapsed_s()
        bench.stream(arm, Twist((0.0, 0.0, 0.0), (0.0, 0.0, _TURN_RAD_S)), 0.5)
        after = bench.next_state(arm).tcp
        x, y, z = (after.rotation * before.rotation.inv()).as_rotvec()
        most = _TURN_RAD_S * (bench.elapsed_s() - begun_s)
        require(0.1 < z < most, f"it has turned by {z:.3f} rad, not by 0.1 to {most:.3f}")
        require(math.hypot(x, y) < 1e-3, "it has turned about another axis")
        require(distance_mm(before, after) < 0.1, "it has moved, too")


def the_arm_stops_by_itself_when_commands_cease(bench: ArmBench) -> None:
    with _under(bench) as arm:
        bench.stream(arm, SIDEWAYS, 0.3)
        bench.advance(bench.deadman_s + 0.2)
        at_rest = bench.next_state(arm).tcp
        bench.advance(0.2)
        _stands(bench, arm, at_rest)
        require(arm.link().failure == "", arm.link().failure)


def a_zero_twist_holds_the_arm_where_it_is(bench: ArmBench) -> None:
    with _under(bench) as arm:
        bench.stream(arm, SIDEWAYS, 0.2)
        bench.stream(arm, Twist.zero(), 0.3)
        at_rest = bench.next_state(arm).tcp
        bench.stream(arm, Twist.zero(), 0.3)
        _stands(bench, arm, at_rest)


def a_twist_that_no_arm_may_follow_is_refused_until_enabled_again(bench: ArmBench) -> None:
    with _under(bench) as arm:
        before, limits = bench.next_state(arm).tcp, bench.limits
        too_fast = _BEYOND * limits.tcp_speed_mm_s / 1000.0
        turning = _BEYOND * limits.joint_speed_rad_s
        for impossible in (
            Twist((0.0, math.nan, 0.0), (0.0, 0.0, 0.0)),
            Twist((0.0, too_fast, 0.0), (0.0, 0.0, 0.0)),
            Twist((0.0, 0.0, 0.0), (0.0, 0.0, turning)),
        ):
            arm.send_twist(impossible)
            is_reported = bench.until(lambda: arm.link().fault is LinkFault.REFUSED)
            require(is_reported, f"{impossible} is not refused, the fault is {arm.link().fault}")
            bench.stream(arm, SIDEWAYS, 0.1)
            _stands(bench, arm, before)
            arm.enable()
            require(arm.link().failure == "", arm.link().failure)
        _moves(bench, arm, before)


def moving_to_joints_arrives_and_leaves_no_servo_enabled(bench: ArmBench) -> None:
    goal = bench.ready_joints + np.radians([6.0, -4.0, -4.0, 3.0, 5.0, -6.0])
    with _under(bench, enable=False) as arm:
        arm.begin_move_to_joints(goal.tolist(), 0.8)

        def arrived() -> bool:
            state = bench.next_state(arm)
            return state.activity is Activity.IDLE and bool(
                np.abs(state.joints - goal).max() < 0.002
            )

        require(bench.until(arrived), "it does not arrive")
        require(bench.next_state(arm).servo is None, "a servo is enabled")
        sent = arm.link().sent
        bench.stream(arm, SIDEWAYS, 0.1)
        require(arm.link().sent == sent, "it takes twists")


def a_move_to_joints_keeps_its_speed(bench: ArmBench) -> None:
    goal = bench.ready_joints + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with _under(bench, enable=False) as arm:
        arm.begin_move_to_joints(goal.tolist(), 0.2)
        bench.advance(0.5)
        speeds = []
        for _ in range(_WINDOWS):
            first = bench.next_state(arm)
            bench.advance(0.5)
            second = bench.next_state(arm)
            seconds = (second.received_ns - first.received_ns) / 1e9
            speeds.append((second.joints[0] - first.joints[0]) / seconds)
        speed = float(np.median(speeds))
        require(abs(speed - 0.2) < 0.05, f"it moves at {speed:.3f} rad/s, not at 0.2")


def a_move_that_no_arm_may_make_is_refused(bench: ArmBench) -> None:
    with _under(bench, enable=False) as arm:
        limits, ready = bench.limits, bench.ready_joints.tolist()
        out_of_reach = [*ready[:1], math.radians(limits.joint_upper_deg[1] + 10.0), *ready[2:]]
        moves: tuple[tuple[list[float], float], ...] = (
            (out_of_reach, 0.5),
            (ready[:5], 0.5),
            (ready, _BEYOND * limits.joint_speed_rad_s),
            (ready, 0.0),
        )
        for joints, speed in moves:
            refused(lambda j=joints, s=speed: arm.begin_move_to_joints(j, s))  # type: ignore[misc]


def a_move_is_ended_by_a_stop_and_not_taken_up_again(bench: ArmBench) -> None:
    goal = bench.ready_joints + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with _under(bench, enable=False) as arm:
        arm.begin_move_to_joints(goal.tolist(), 0.5)
        bench.advance(0.3)
        arm.stop()
        stopped = bench.until(lambda: bench.next_state(arm).activity is Activity.STOPPED)
        require(stopped, "it does not stop")
        bench.advance(0.3)
        at_rest = bench.next_state(arm)
        arm.enable()
        bench.advance(0.3)
        _stands(bench, arm, at_rest.tcp)


def gripper_commands_are_reported(bench: ArmBench) -> None:
    with _under(bench) as arm:
        require(bench.next_state(arm).gripper_closed is None, "it is known before a command")
        for closed in (True, False):
            arm.set_gripper(closed)
            is_done = bench.until(
                lambda c=closed: bench.next_state(arm).gripper_closed is c  # type: ignore[misc]
            )
            require(is_done, f"{'closing' if closed else 'opening'} is not reported")
        bench.advance(0.4)
        require(arm.link().failure == "", arm.link().failure)


def stop_stops_and_nothing_moves_until_enabled(bench: ArmBench) -> None:
    with _under(bench) as arm:
        bench.stream(arm, SIDEWAYS, 0.2)
        arm.stop()
        arm.stop()
        stopped = bench.until(lambda: bench.next_state(arm).activity is Activity.STOPPED)
        require(stopped, "it does not stop")
        bench.advance(0.2)
        at_rest, sent = bench.next_state(arm).tcp, arm.link().sent
        bench.stream(arm, SIDEWAYS, 0.2)
        arm.set_gripper(True)
        bench.advance(0.1)
        _stands(bench, arm, at_rest)
        require(bench.next_state(arm).gripper_closed is None, "its gripper takes commands")
        require(arm.link().sent == sent, "it takes commands")
        require(arm.link().failure == "", arm.link().failure)
        arm.enable()
        _moves(bench, arm, at_rest)


ARM_PROMISES: tuple[Promise[ArmBench], ...] = (
    before_connecting_nothing_moves_and_nothing_breaks,
    connecting_leaves_the_arm_stopped_where_it_is,
    closing_twice_is_fine_and_one_may_connect_again,
    enabling_does_not_move_the_arm,
    a_twist_moves_the_tcp_with_its_velocity,
    a_twist_turns_the_tcp_about_its_axis_in_the_base_frame,
    the_arm_stops_by_itself_when_commands_cease,
    a_zero_twist_holds_the_arm_where_it_is,
    a_twist_that_no_arm_may_follow_is_refused_until_enabled_again,
    moving_to_joints_arrives_and_leaves_no_servo_enabled,
    a_move_to_joints_keeps_its_speed,
    a_move_that_no_arm_may_make_is_refused,
    a_move_is_ended_by_a_stop_and_not_taken_up_again,
    gripper_commands_are_reported,
    stop_stops_and_nothing_moves_until_enabled,
)
