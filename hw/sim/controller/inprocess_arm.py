"""The arm in virtual time: the controller model without sockets, stepped by the caller's clock.

It speaks to the model in the same registers as the driver does over TCP, and passes the same
contract suite (tests/contract/test_arm.py).
"""

from __future__ import annotations

import math
import struct

import numpy as np

from hw.arm import Arm, ServoMode
from hw.boundary import TcpBoundary
from hw.lite6.codes import Code, controller_error_sentence, return_code_sentence
from hw.lite6.kinematics import pose_from_matrix, within_joint_limits
from hw.sim.controller.codes import Mode, Register, ReplyBit, State
from hw.sim.controller.model import CYCLE_NS, ControllerModel, ReportKind
from hw.sim.controller.plant import GripperDrive, IdealPlant
from hw.sim.controller.registers import ALL_JOINTS, TOOL_DIGITAL_OUT
from tams_app.config import LITE6_MAX_JOINT_SPEED_RAD_S, LITE6_MAX_TCP_SPEED_MM_S, ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import ArmState, CommandLink, LinkFault, Pose, Twist
from tams_app.runtime.clock import NS_PER_S, Clock

MOVE_ACCELERATION_RAD_S2 = 1.0
MAX_POSE_STEP_MM = 10.0
GRIPPER_ATTEMPTS = 3
OLDEST_FIRMWARE = (1, 8, 0)  # older ones know no deadman time

_REPORT_PERIOD_NS = NS_PER_S // ReportKind.REAL.rate_hz
_MODES = {ServoMode.VELOCITY: Mode.CARTESIAN_VELOCITY, ServoMode.POSE: Mode.SERVO}
_TOOL_HOST = 9
# writes to the tool outputs: which ones change (high byte), and to what
_OPEN_COMMAND, _CLOSE_COMMAND = 0x0301, 0x0302
_CLOSED_BY_DRIVE = {
    GripperDrive.OFF: None,
    GripperDrive.OPEN: False,
    GripperDrive.CLOSE: True,
}
_REFUSED = ReplyBit.INVALID | ReplyBit.NOT_READY | ReplyBit.ERROR
_INVALID_CODE = 10  # what the SDK returns for it
_NO_FAILURE = ("", LinkFault.NONE)
_NOT_CONNECTED = "The arm is not connected; connect it first."


class InProcessArm(Arm):
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
        self._servo: ServoMode | None = None  # whose commands are taken
        self._last_pose: Pose | None = None
        self._state: ArmState | None = None
        self._gripper_closed: bool | None = None
        self._sent = 0
        self._acknowledged_ns = 0
        self._failure: tuple[str, LinkFault] = _NO_FAILURE

    # --- time -----------------------------------------------------------------------------------

    def advance(self, duration_ns: int) -> None:
        """Let the clock go on by `duration_ns` and the arm with it."""
        self._clock.sleep_until_ns(self._clock.now_ns() + duration_ns)
        self._catch_up()

    @property
    def simulated_ns(self) -> int:
        """The instant the arm and its plant stand at: of the controller's last cycle."""
        return self._cycle_ns

    def skip_standstill(self, longest_ns: int) -> None:
        """Leave out what is more than `longest_ns` behind the clock: the process stood still."""
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
            joints=self.model.joints,
            tcp=pose_from_matrix(self.model.tcp),
            mode=int(self.model.mode),
            state=int(self.model.state),
            error_code=int(self.model.error_code),
            warning_code=self.model.warning_code,
            gripper_closed=self._gripper_closed,
        )

    # --- setting up -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Connect, stop the arm, check and configure it; DeviceError says what is wrong.

        An error of the controller is also a DeviceError, but the connection stays, for
        `clear_errors` and another `connect`.
        """
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
            edges = struct.pack("<6i", *self._boundary.on_the_wire)
            self._request(Register.SET_BOUNDARY, edges)
            self._request(Register.SET_FENCE, bytes([1]))
        self._request(Register.SET_LOAD, load)
        self._gripper_closed = _CLOSED_BY_DRIVE[self.model.gripper]
        self._acknowledged_ns = self._clock.now_ns()
        self.stop()
        self._report_ns = self._clock.now_ns() + _REPORT_PERIOD_NS
        self._take_report(self._clock.now_ns())

    def enable(self, servo: ServoMode) -> None:
        self._enter(_MODES[servo])
        self._servo = servo
        self._last_pose = pose_from_matrix(self.model.tcp)

    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        goal = np.array(joints, dtype=np.float64)
        if goal.shape != (6,) or not np.isfinite(goal).all() or not within_joint_limits(goal):
            raise DeviceError("The joint angles to move to are outside the Lite 6's limits.")
        if not 0 < speed <= LITE6_MAX_JOINT_SPEED_RAD_S:
            raise DeviceError(f"A joint speed of {speed:g} rad/s is outside the Lite 6's limits.")
        self._enter(Mode.POSITION)
        command = struct.pack("<10f", *goal, 0.0, speed, MOVE_ACCELERATION_RAD_S2, 0.0)
        self._demand(Register.MOVE_JOINT, command)

    def clear_errors(self) -> None:
        self._servo = None
        self._request(Register.CLEAN_ERROR)
        self._request(Register.CLEAN_WARNING)
        self.stop()
        self._raise_error()
        self._failure = _NO_FAILURE

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
            sentence, fault = _NOT_CONNECTED, LinkFault.LOST
        return CommandLink(self._sent, self._acknowledged_ns, 0, 0, sentence, fault)

    def send_twist(self, twist: Twist) -> None:
        if self._servo is None:
            return
        refusal = self._twist_refusal(twist)
        if refusal:
            self._fail(refusal, LinkFault.REFUSED)
            return
        payload = struct.pack("<6f", *(twist.linear * 1000.0), *twist.angular) + bytes(1)
        deadman = struct.pack("<f", self._config.velocity_deadman_s)
        self._command(Register.SET_CARTESIAN_VELOCITY, payload + deadman)

    def send_pose(self, pose: Pose) -> None:
        if self._servo is None:
            return
        refusal = self._pose_refusal(pose)
        if refusal:
            self._fail(refusal, LinkFault.REFUSED)
            return
        self._last_pose = pose
        payload = struct.pack("<6f", *(pose.position * 1000.0), *pose.rotation.as_rotvec())
        base_frame_absolute = struct.pack("<2fiB", 0.0, 0.0, 0, 0)
        self._command(Register.MOVE_SERVO_CARTESIAN_AA, payload + base_frame_absolute)

    def set_gripper(self, closed: bool) -> None:
        if self._servo is None:
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
            self._gripper_closed = closed
            self._check_gripper(closed)

    def _check_gripper(self, closed: bool) -> None:
        """Compare the tool outputs with the command."""
        driven = _CLOSED_BY_DRIVE[self.model.gripper]
        if driven is not closed:
            self._gripper_closed = driven
            self._fail(
                "The gripper's outputs are not what was commanded; check its plug at the flange.",
                LinkFault.GRIPPER,
            )

    def stop(self) -> None:
        self._servo = None
        if self._connected:
            self._request(Register.SET_STATE, bytes([State.STOPPED]))

    # --- refusals -------------------------------------------------------------------------------

    def _check_identity(self) -> None:
        if tuple(int(part) for part in self.model.firmware.split(".")) < OLDEST_FIRMWARE:
            raise DeviceError(
                f"The arm's firmware ({self.model.firmware}) would not stop by itself when "
                "commands cease; update it with UFACTORY Studio."
            )
        if self.model.settings.simulation_robot:
            raise DeviceError(
                "The arm only pretends to move; switch its simulation mode off in UFACTORY Studio."
            )

    def _twist_refusal(self, twist: Twist) -> str:
        """Why this twist is not sent, "" if it may be."""
        speed_mm_s = float(np.linalg.norm(twist.linear)) * 1000.0
        turn_rad_s = float(np.linalg.norm(twist.angular))
        if self._servo is ServoMode.POSE:
            return "The arm is in the pose servo and takes no velocities; enable it anew."
        if not speed_mm_s <= LITE6_MAX_TCP_SPEED_MM_S:  # also true for NaN
            return f"A velocity of {speed_mm_s:g} mm/s was refused; please report this error."
        if not turn_rad_s <= LITE6_MAX_JOINT_SPEED_RAD_S:
            return f"A turn of {turn_rad_s:g} rad/s was refused; please report this error."
        return ""

    def _pose_refusal(self, pose: Pose) -> str:
        """Why this pose is not sent, "" if it may be."""
        if self._servo is ServoMode.VELOCITY:
            return "The arm is in the velocity servo and takes no poses; enable it anew."
        if self._last_pose is None or not np.isfinite(pose.rotation.as_quat()).all():
            return "A pose that is none was refused; please report this error."
        step_mm = float(np.linalg.norm(pose.position - self._last_pose.position)) * 1000.0
        if not step_mm <= MAX_POSE_STEP_MM:
            return f"A step of {step_mm:g} mm was refused; please report this error."
        return ""

    def _fail(self, sentence: str, fault: LinkFault) -> None:
        """Nothing moves until the arm is enabled again."""
        self._failure = (sentence, fault)
        self._servo = None

    def _raise_error(self) -> None:
        if self.model.error_code:
            raise DeviceError(controller_error_sentence(self.model.error_code))

    # --- requests -------------------------------------------------------------------------------

    def _enter(self, mode: Mode) -> None:
        """Release the brakes and be ready in `mode`; DeviceError if the controller refuses."""
        self._servo = None
        self._request(Register.MOTION_ENABLE, bytes([ALL_JOINTS, 1]))
        self._request(Register.SET_MODE, bytes([mode]))
        self._demand(Register.SET_STATE, bytes(1))
        self._failure = _NO_FAILURE

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
            raise DeviceError(_NOT_CONNECTED)
        self._catch_up()
        return self.model.handle(register, payload, self._clock.now_ns())[0]

    def _reason(self, register: Register, status: int) -> str:
        """One sentence: why the controller does not do what `register` asks."""
        call = register.name.lower().replace("_", " ")
        if status & ReplyBit.ERROR:
            return controller_error_sentence(self.model.error_code)
        return return_code_sentence(
            _INVALID_CODE if status & ReplyBit.INVALID else Code.NOT_READY, call
        )
