"""The arm in virtual time: the controller model without sockets, stepped by the caller's clock.

It uses the same registers of the model as the driver does over TCP, and passes the same
contract suite (tests/contract/test_arm.py).
"""

from __future__ import annotations

import math
import struct

import numpy as np

from hw.arm import Plant, SimulatedArm, TcpBoundary
from hw.lite6.commands import (
    GRIPPER_ATTEMPTS,
    NO_FAILURE,
    NOT_CONNECTED,
    OUTPUTS_DIFFER,
    READY_ACCELERATION_RAD_S2,
    activity_of,
    arm_fault,
    boundary_edges,
    checked_goal,
    error_sentence,
    servo_of,
    twist_refusal,
)
from hw.lite6.kinematics import pose_from_matrix
from hw.lite6.protocol import (
    AXES,
    DRIVE_ERRORS,
    LITE6_TYPE,
    Code,
    Mode,
    Register,
    ReplyBit,
    StateCommand,
    return_code_sentence,
)
from hw.lite6.report import parse_status
from hw.lite6.settings import foreign_refusal, unfitness
from hw.sim.controller.core import outputs_for
from hw.sim.controller.model import (
    ALL_JOINTS,
    CYCLE_NS,
    TOOL_DIGITAL_OUT,
    ControllerModel,
    IdealPlant,
    ReportKind,
)
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import ArmState, CommandLink, LinkFault, Twist, Vector
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S
from tams_app.vectors import times

_REPORT_PERIOD_NS = NS_PER_S // ReportKind.REAL.rate_hz
_TOOL_HOST = 9
# writes to the tool outputs: which ones change (high byte), and to what
_OPEN_COMMAND, _CLOSE_COMMAND = 0x0301, 0x0302
_REFUSED = ReplyBit.INVALID | ReplyBit.NOT_READY | ReplyBit.ERROR


class InProcessArm(SimulatedArm):
    """An arm whose controller lives in this process; every call first brings it up to the clock.

    For one thread. Commands are acknowledged at once, so `link` never shows a slow reply.
    """

    def __init__(
        self,
        config: ArmConfig,
        clock: Clock,
        model: ControllerModel | None = None,
        boundary: TcpBoundary | None = None,
    ) -> None:
        """Without a `model` an ideal arm at the factory's home.

        `boundary`: set in the controller on connecting; None leaves the controller's as it is.
        """
        self._boundary = boundary
        self.model = model or ControllerModel(IdealPlant())
        self._config = config
        self._clock = clock
        self._cycle_ns = clock.now_ns()
        self._report_ns = clock.now_ns()
        self._connected = False
        self._takes_commands = False
        self._state: ArmState | None = None
        self._sent = 0
        self._acknowledged_ns = 0
        self._failure: tuple[str, LinkFault] = NO_FAILURE

    # --- time -----------------------------------------------------------------------------------

    @property
    def simulated_ns(self) -> int:
        return self._cycle_ns

    def skip_standstill(self, longest_ns: int) -> None:
        behind_ns = self._clock.now_ns() - self._cycle_ns
        if behind_ns > longest_ns:
            self._cycle_ns += behind_ns - longest_ns
            self._report_ns = max(self._report_ns, self._cycle_ns)

    def _catch_up(self) -> None:
        now_ns = self._clock.now_ns()
        while self._cycle_ns + CYCLE_NS <= now_ns:
            self._cycle_ns += CYCLE_NS
            self.model.step(self._cycle_ns)
            if self._cycle_ns >= self._report_ns:
                self._report_ns += _REPORT_PERIOD_NS
                self._take_report(self._cycle_ns)

    def _take_report(self, now_ns: int) -> None:
        if self.model.reports_frozen or not self._connected:
            return
        self._state = ArmState(
            received_ns=now_ns,
            joints=np.array(self.model.joints),
            tcp=pose_from_matrix(self.model.tcp),
            activity=activity_of(self.model.state),
            servo=servo_of(self.model.mode),
            fault=arm_fault(self.model.error_code, self.model.drive_codes),
            warning_code=self.model.warning_code,
            gripper_closed=self.model.settings.closing,
            hottest_motor_c=max(self.model.temperatures_c),
        )

    # --- setting up -----------------------------------------------------------------------------

    def connect(self) -> None:
        self._check_identity()
        self._connected = True
        self.stop()
        self._raise_error()
        config = self._config
        angles_rad = [math.radians(angle) for angle in config.tcp_offset_mm_deg[3:]]
        offset = struct.pack("<6f", *config.tcp_offset_mm_deg[:3], *angles_rad)
        load = struct.pack("<4f", config.tcp_load_kg, *config.tcp_load_centre_mm)
        self._request(Register.SET_COLLISION_SENSITIVITY, bytes([config.collision_sensitivity]))
        self._request(Register.SET_SELF_COLLISION_CHECK, bytes([1]))
        self._request(Register.SET_TCP_OFFSET, offset)
        if self._boundary is not None:
            edges = struct.pack("<6i", *boundary_edges(self._boundary))
            self._request(Register.SET_BOUNDARY, edges)
            self._request(Register.SET_FENCE, bytes([1]))
        self._request(Register.SET_LOAD, load)
        self._acknowledged_ns = self._clock.now_ns()
        self.stop()
        self._report_ns = self._clock.now_ns() + _REPORT_PERIOD_NS
        self._take_report(self._clock.now_ns())

    def enable(self) -> None:
        self._enter(Mode.CARTESIAN_VELOCITY)
        self._takes_commands = True

    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        goal = checked_goal(joints, speed)
        self._enter(Mode.POSITION)
        command = struct.pack("<10f", *goal, 0.0, speed, READY_ACCELERATION_RAD_S2, 0.0)
        self._demand(Register.MOVE_JOINT, command)

    def clear_errors(self) -> None:
        self._takes_commands = False
        if self.model.error_code in DRIVE_ERRORS:
            self._request(Register.MOTION_ENABLE, bytes([ALL_JOINTS, 1]))
        self._request(Register.CLEAN_ERROR)
        self._request(Register.CLEAN_WARNING)
        self.stop()
        self._raise_error()
        self._failure = NO_FAILURE

    def close(self) -> None:
        self.stop()
        self._connected = False
        self._state = None

    # --- the control loop's side ----------------------------------------------------------------

    def state(self) -> ArmState | None:
        self._catch_up()
        return self._state

    def link(self) -> CommandLink:
        sentence, fault = self._failure
        if not self._connected:
            sentence, fault = NOT_CONNECTED, LinkFault.LOST
        return CommandLink(self._sent, self._acknowledged_ns, 0, 0, sentence, fault)

    def send_twist(self, twist: Twist) -> None:
        if not self._takes_commands:
            return
        if refusal := twist_refusal(twist):
            self._fail(refusal, LinkFault.REFUSED)
            return
        payload = struct.pack("<6f", *times(twist.linear, 1000.0), *twist.angular) + bytes(1)
        deadman = struct.pack("<f", self._config.velocity_deadman_s)
        self._command(Register.SET_CARTESIAN_VELOCITY, payload + deadman)

    def set_gripper(self, closed: bool) -> None:
        if not self._takes_commands:
            return
        outputs = struct.pack("<f", _CLOSE_COMMAND if closed else _OPEN_COMMAND)
        address = struct.pack(">BH", _TOOL_HOST, TOOL_DIGITAL_OUT)
        for _ in range(GRIPPER_ATTEMPTS):
            self._sent += 1
            status = self._request(Register.TOOL_GPIO_WRITE, address + outputs)
            if not status & ReplyBit.INVALID:
                break
        if status & ReplyBit.ERROR:
            self._fail(self._reason(Register.TOOL_GPIO_WRITE, status), LinkFault.REFUSED)
        elif status & ReplyBit.INVALID:
            self._fail(self._reason(Register.TOOL_GPIO_WRITE, status), LinkFault.GRIPPER)
        else:
            self._acknowledged_ns = self._clock.now_ns()
            if self.model.settings.closing is not closed:
                self._fail(OUTPUTS_DIFFER, LinkFault.GRIPPER)

    def stop(self) -> None:
        self._takes_commands = False
        if self._connected:
            self._request(Register.SET_STATE, bytes([StateCommand.STOP]))

    # --- refusals -------------------------------------------------------------------------------

    def _check_identity(self) -> None:
        firmware = tuple(int(part) for part in self.model.firmware.split("."))
        status = parse_status(self.model.report(ReportKind.RICH), self._clock.now_ns())
        if problem := unfitness(AXES, LITE6_TYPE, firmware) or foreign_refusal(status):
            raise DeviceError(problem)

    def _fail(self, sentence: str, fault: LinkFault) -> None:
        """Nothing moves until the arm is enabled again."""
        self._failure = (sentence, fault)
        self._takes_commands = False

    def _raise_error(self) -> None:
        if self.model.error_code:
            raise DeviceError(error_sentence(self.model.error_code))

    # --- requests -------------------------------------------------------------------------------

    def _enter(self, mode: Mode) -> None:
        """Release the brakes and be ready in `mode`; DeviceError if the controller refuses."""
        self._takes_commands = False
        self._request(Register.MOTION_ENABLE, bytes([ALL_JOINTS, 1]))
        self._request(Register.SET_MODE, bytes([mode]))
        self._demand(Register.SET_STATE, bytes([StateCommand.READY]))
        self._failure = NO_FAILURE

    def _demand(self, register: Register, payload: bytes = b"") -> None:
        """A request that must find or leave the controller ready; DeviceError if not."""
        status = self._request(register, payload)
        if status & _REFUSED:
            raise DeviceError(self._reason(register, status))

    def _command(self, register: Register, payload: bytes) -> None:
        """A command of the control loop; what became of it shows in `link`."""
        self._sent += 1
        status = self._request(register, payload)
        if status & _REFUSED:
            self._fail(self._reason(register, status), LinkFault.REFUSED)
            return
        self._acknowledged_ns = self._clock.now_ns()

    def _request(self, register: Register, payload: bytes = b"") -> int:
        """The status byte of the reply."""
        if not self._connected:
            raise DeviceError(NOT_CONNECTED)
        self._catch_up()
        return self.model.handle(register, payload, self._clock.now_ns())[0]

    def _reason(self, register: Register, status: int) -> str:
        """One sentence: why the controller does not do what `register` asks."""
        call = register.name.lower().replace("_", " ")
        if status & ReplyBit.ERROR:
            return error_sentence(self.model.error_code)
        return return_code_sentence(
            Code.INVALID if status & ReplyBit.INVALID else Code.NOT_READY, call
        )


def simulated_lite6(
    config: ArmConfig,
    clock: Clock,
    joints: Vector,
    boundary: TcpBoundary | None,
    plant: Plant | None,
    gripper_closed: bool | None,
) -> InProcessArm:
    """The `simulation` of the Lite 6; see `hw.arms.simulated_arm`."""
    model = ControllerModel(plant or IdealPlant(), joints)
    model.settings.tool_outputs = outputs_for(gripper_closed)
    return InProcessArm(config, clock, model, boundary)
