"""A second kind of arm: a toy with six axes, whose controller has words and numbers of its own.

It has the links of the simulated rig's arm, so that it can work in the same scene; controller,
driver and faults are its own. `ARM_KINDS["toy"] = "tests.contract.toy_arm:KIND"` makes it known.
"""

from __future__ import annotations

import socket
from dataclasses import replace

import numpy as np

from hw.arm import (
    Arm,
    ArmKind,
    ArmLimits,
    FoundArm,
    Plant,
    SimulatedArm,
    TcpBoundary,
)
from hw.arm_report import ArmReport
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from hw.sim.controller.model import IdealPlant
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import (
    Activity,
    ArmFault,
    ArmKinematics,
    ArmState,
    CommandLink,
    LinkFault,
    ServoMode,
    Twist,
    Vector,
)
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S
from tams_app.vectors import plain

CYCLE_NS = 4_000_000
CYCLE_S = CYCLE_NS / NS_PER_S
REPORT_NS = 10_000_000
LIMITS = ArmLimits(
    joint_lower_deg=(-170.0, -100.0, -5.0, -170.0, -120.0, -170.0),
    joint_upper_deg=(170.0, 100.0, 200.0, 170.0, 120.0, 170.0),
    joint_speed_rad_s=2.0,
    tcp_speed_mm_s=300.0,
    tcp_acceleration_mm_s2=20_000.0,
    reach_mm=450.0,
    shoulder_mm=243.3,
    stretched_mm=505.2,
)
BUMPED, FENCED, BUTTON = 7, 8, 9
FAULTS = {
    BUMPED: ArmFault(BUMPED, "T7 (bumped into something): free the toy"),
    FENCED: ArmFault(FENCED, "T8 (outside its fence): bring the toy back"),
    BUTTON: ArmFault(BUTTON, "T9 (emergency stop): release the emergency stop"),
}
_NOT_CONNECTED = "The toy is not connected; connect it first."


class ToyBox:
    """The toy's controller: what it is told to do, one cycle at a time."""

    def __init__(self, joints: Vector, plant: Plant | None = None) -> None:
        self.joints = joints.copy()
        self.measured = joints.copy()
        self.runs = self.follows = False  # moves, follows twists
        self.fault = 0
        self.button_pressed = False
        self.boundary: TcpBoundary | None = None
        self.gripper_closed: bool | None = None
        self.gripper_works = "yes"  # or "refuses" or "ignores"
        self.reports_frozen = False
        self.kinematics = Lite6Model()
        self._plant = plant or IdealPlant()
        self._twist, self._until_ns = np.zeros(6), 0
        self._goal: tuple[Vector, float] | None = None

    @property
    def moves(self) -> bool:
        return bool(self._twist.any()) or self._goal is not None

    def halt(self, fault: int = 0) -> None:
        self.fault = self.fault or fault
        self.runs, self.follows, self._goal = False, False, None
        self._twist = np.zeros(6)

    def run(self, goal: tuple[Vector, float] | None) -> None:
        """Move to joints at a speed; None: follow twists."""
        self.halt()
        self.runs, self.follows, self._goal = True, goal is None, goal

    def twist(self, twist: Vector, until_ns: int) -> None:
        self._twist, self._until_ns = twist, until_ns

    def cycle(self, now_ns: int) -> None:
        if now_ns >= self._until_ns:
            self._twist = np.zeros(6)
        if self._twist.any():
            rows = self.kinematics.jacobian(self.joints)
            self.joints = self.joints + np.linalg.solve(rows, self._twist) * CYCLE_S
        elif self._goal is not None:
            goal, speed = self._goal
            change = goal - self.joints
            share = speed * CYCLE_S / max(float(np.abs(change).max()), 1e-12)
            self._goal = None if share >= 1.0 else self._goal
            self.joints = goal if share >= 1.0 else self.joints + share * change
        state = self._plant.step(plain(self.joints), self.gripper_closed, CYCLE_NS)
        self.measured = np.array(state.joints)
        outside = self.boundary is not None and not self.boundary.contains(
            self.kinematics.tcp_matrix(self.joints)[:3, 3]
        )
        if self.runs and (state.collision or (outside and self.follows)):
            self.halt(BUMPED if state.collision else FENCED)


class ToyArm(SimulatedArm):
    """The toy's driver; the box lives in this process."""

    def __init__(
        self, config: ArmConfig, clock: Clock, box: ToyBox, boundary: TcpBoundary | None
    ) -> None:
        self.box = box
        self._config, self._clock, self._boundary = config, clock, boundary
        self._cycle_ns = self._report_ns = clock.now_ns()
        self._connected = False
        self._state: ArmState | None = None
        self._link = CommandLink(0, 0, 0, 0, "")

    def connect(self) -> None:
        self._connected = True
        self._catch_up()
        self.box.halt()
        self._raise_fault()
        self.box.kinematics = Lite6Model(offset_from_mm_deg(self._config.tcp_offset_mm_deg))
        self.box.boundary = self._boundary or self.box.boundary
        self._link = replace(self._link, acknowledged_ns=self._clock.now_ns())
        self._report(self._clock.now_ns())

    def enable(self) -> None:
        self._check()
        self.box.run(None)
        self._link = replace(self._link, failure="", fault=LinkFault.NONE)

    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        self._check()
        goal = np.array(joints)
        lower, upper = np.radians(LIMITS.joint_lower_deg), np.radians(LIMITS.joint_upper_deg)
        if goal.shape != (6,) or not ((goal >= lower) & (goal <= upper)).all():
            raise DeviceError("The joints are outside the toy's limits.")
        if not 0 < speed <= LIMITS.joint_speed_rad_s:
            raise DeviceError("The speed is outside the toy's limits.")
        self.box.run((goal, speed))

    def state(self) -> ArmState | None:
        self._catch_up()
        return self._state

    def link(self) -> CommandLink:
        if not self._connected:
            return replace(self._link, failure=_NOT_CONNECTED, fault=LinkFault.LOST)
        return self._link

    def send_twist(self, twist: Twist) -> None:
        self._catch_up()
        if self.box.fault and self._link.sent and self._connected:
            self._fail(FAULTS[self.box.fault].sentence, LinkFault.REFUSED)
        if not self.box.follows:
            return
        if not float(np.linalg.norm(twist.linear)) * 1000.0 <= LIMITS.tcp_speed_mm_s:
            self._fail("A velocity was refused.", LinkFault.REFUSED)
            return
        if not float(np.linalg.norm(twist.angular)) <= LIMITS.joint_speed_rad_s:
            self._fail("A turn was refused.", LinkFault.REFUSED)
            return
        until_ns = self._clock.now_ns() + round(self._config.velocity_deadman_s * NS_PER_S)
        self.box.twist(np.concatenate((twist.linear, twist.angular)), until_ns)
        self._sent()

    def set_gripper(self, closed: bool) -> None:
        if not self.box.follows:
            return
        self._sent()
        if self.box.gripper_works == "yes":
            self.box.gripper_closed = closed
        else:
            self._fail("The gripper's outputs are not what was told.", LinkFault.GRIPPER)

    def stop(self) -> None:
        if self._connected:
            self._catch_up()
            self.box.halt()

    def clear_errors(self) -> None:
        self._required()
        self.box.halt()
        self.box.fault = BUTTON if self.box.button_pressed else 0
        self._report(self._clock.now_ns())
        self._raise_fault()
        self._link = replace(self._link, failure="", fault=LinkFault.NONE)

    def close(self) -> None:
        self.stop()
        self._connected, self._state = False, None

    @property
    def simulated_ns(self) -> int:
        return self._cycle_ns

    def skip_standstill(self, longest_ns: int) -> None:
        self._cycle_ns = max(self._cycle_ns, self._clock.now_ns() - longest_ns)

    def _required(self) -> None:
        if not self._connected:
            raise DeviceError(_NOT_CONNECTED)
        self._catch_up()

    def _check(self) -> None:
        self._required()
        self._raise_fault()

    def _raise_fault(self) -> None:
        if self.box.fault:
            raise DeviceError(FAULTS[self.box.fault].sentence)

    def _sent(self) -> None:
        now_ns = self._clock.now_ns()
        self._link = replace(self._link, sent=self._link.sent + 1, acknowledged_ns=now_ns)

    def _fail(self, sentence: str, fault: LinkFault) -> None:
        self.box.halt()
        self._link = replace(self._link, failure=sentence, fault=fault)

    def _catch_up(self) -> None:
        now_ns = self._clock.now_ns()
        while self._cycle_ns + CYCLE_NS <= now_ns:
            self._cycle_ns += CYCLE_NS
            self.box.cycle(self._cycle_ns)
            if self._cycle_ns >= self._report_ns:
                self._report_ns += REPORT_NS
                self._report(self._cycle_ns)

    def _report(self, now_ns: int) -> None:
        box = self.box
        if box.reports_frozen or not self._connected:
            return
        stands = Activity.IDLE if box.runs else Activity.STOPPED
        self._state = ArmState(
            received_ns=now_ns,
            joints=box.measured.copy(),
            tcp=box.kinematics.tcp_pose(box.measured),
            activity=Activity.MOVING if box.moves else stands,
            servo=ServoMode.VELOCITY if box.follows else None,
            fault=FAULTS.get(box.fault),
            gripper_closed=box.gripper_closed,
        )


class ToyStop:
    """What the guard stops the toy by: one datagram without an acknowledgement."""

    failure = ""
    pending = False

    def __init__(self, host: str, port: int, reply_timeout_s: float, name: str) -> None:
        self._address = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def start(self) -> None:
        """A datagram needs no connection."""

    def request_stop(self) -> None:
        self._socket.sendto(b"off", self._address)

    def wait_acknowledged(self, timeout_s: float) -> bool:
        return True

    def close(self) -> None:
        self._socket.close()


class ToyReports:
    """What the guard knows of the toy by: it asks for a report each time, and gets numbers."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._address = (host, port)

    def start(self) -> None:
        self._socket.connect(self._address)

    def newest(self, now_ns: int) -> ArmReport | None:
        report = None
        try:
            self._socket.send(b"where")
            while True:
                x, y, z, *joints = map(float, self._socket.recv(512).split())
                report = ArmReport((x, y, z), tuple(joints))
        except OSError:  # that was all, or nothing listens
            return report

    def close(self) -> None:
        self._socket.close()


def simulated_toy(
    config: ArmConfig,
    clock: Clock,
    joints: Vector,
    boundary: TcpBoundary | None,
    plant: Plant | None = None,
    gripper_closed: bool | None = None,
) -> SimulatedArm:
    box = ToyBox(joints, plant)
    box.gripper_closed = gripper_closed
    return ToyArm(config, clock, box, boundary)


class ToyKind(ArmKind):
    title = "toy"
    limits = LIMITS
    stop_channel = "tests.contract.toy_arm:ToyStop"
    report_watch = "tests.contract.toy_arm:ToyReports"
    simulation = "tests.contract.toy_arm:simulated_toy"

    def make_arm(
        self,
        config: ArmConfig,
        clock: Clock,
        control_rate_hz: float,
        boundary: TcpBoundary | None,
    ) -> Arm:
        return simulated_toy(config, clock, np.radians(config.ready_joints_deg), boundary)

    def kinematics(self, config: ArmConfig) -> ArmKinematics:
        return Lite6Model(offset_from_mm_deg(config.tcp_offset_mm_deg))

    def find(self, config: ArmConfig) -> FoundArm:
        return FoundArm(problem="", description="a toy")


KIND = ToyKind()
