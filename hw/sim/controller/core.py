"""Modes, states, errors and motion of the Lite 6 controller box, one cycle at a time.

Behaviour from FINDINGS 8 and the SDK's documentation; where neither says, the stricter reading was
taken. `model.py` puts the registers and reports of the wire around it.
"""

from __future__ import annotations

from dataclasses import dataclass

from hw.arm import Plant, TcpBoundary
from hw.lite6.kinematics import HOME_JOINTS, Lite6Model, Matrix, pose_from_mm_rpy
from hw.lite6.protocol import DRIVE_ERRORS, ErrorCode, Mode, State, StateCommand
from hw.sim.controller.joint_servo import (
    AT_REST,
    CYCLE_NS,
    CYCLE_S,
    CommandError,
    MotionError,
    MoveServo,
    TwistServo,
    brake,
    check_motion,
)
from tams_app.vectors import ZERO, Joints, Numbers, floats, norm, plain

_WIDEST = TcpBoundary((-9999, -9999, -9999), (9999, 9999, 9999))
_OPEN, _CLOSE = 0b01, 0b10  # the first two tool outputs


@dataclass(slots=True)
class ControllerSettings:
    """The controller's settings, in units of the wire (mm, rad, kg); as a fresh Lite 6."""

    tcp_offset: tuple[float, ...] = (0.0,) * 6  # x, y, z [mm], roll, pitch, yaw [rad]
    load: tuple[float, ...] = (0.0,) * 4  # mass [kg], centre of gravity [mm]
    collision_sensitivity: int = 3  # 0 is off
    fence: bool = False
    boundary: TcpBoundary = _WIDEST
    self_collision_check: bool = True
    tool_outputs: int = 0  # bit n is tool output n
    clear_outputs_on_stop: bool = False
    # what another program may have set; the model reports it, no more
    simulation_robot: bool = False  # only pretends to move
    reduced: tuple[float, float] | None = None  # its speeds [mm/s, rad/s]; None: off
    collision_rebound: bool = False
    approximate_motion: bool = False  # passes singularities beside the path
    gravity: tuple[float, ...] = (0.0, 0.0, -1.0)
    world_offset: tuple[float, ...] = (0.0,) * 6  # x, y, z [mm], roll, pitch, yaw [rad]

    @property
    def closing(self) -> bool | None:
        """True if the outputs drive the gripper closed, False if open; None: neither or both."""
        return {_OPEN: False, _CLOSE: True}.get(self.tool_outputs & (_OPEN | _CLOSE))


def outputs_for(closed: bool | None) -> int:
    """The tool outputs that drive the gripper closed or open; None: neither."""
    return 0 if closed is None else _CLOSE if closed else _OPEN


class ControllerCore:
    """The box's state and behaviour; joint targets go to `plant`. Holds no thread or clock."""

    def __init__(
        self, plant: Plant, start_joints: Numbers = HOME_JOINTS, firmware: str = "2.6.0"
    ) -> None:
        """`start_joints` [rad]: where `plant` stands; `firmware`: three numbers."""
        self.firmware = firmware
        self.settings: ControllerSettings = ControllerSettings()
        self.mode = Mode.POSITION
        self.enabled = False
        self.error_code, self.warning_code = 0, 0
        self.drive_codes: tuple[int, ...] = (0,) * 6  # errors of the joints' own drives
        self.temperatures_c: tuple[int, ...] = (30,) * 6  # of the joints' motors
        self.reports_frozen = False  # for its servers: no report leaves the box
        self._drives_refuse = False
        self._state = State.STOPPED
        self._emergency_stop = False
        self._plant = plant
        self._kinematics = Lite6Model()
        self._tool = ZERO  # the TCP in the flange's frame [m]
        self._commanded = self._measured = plain(start_joints)
        self._velocity = AT_REST
        self._braking = False
        self._measured_tcp: Matrix | None = None
        self._now_ns = 0
        self._moves = MoveServo()
        self._twist_servo = TwistServo()

    # --- its state ------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        if self._state is State.STANDBY and self.moving:
            return State.MOVING
        return self._state

    @property
    def moving(self) -> bool:
        """True if the commanded joints move, or will in the next cycle."""
        return any(self._velocity) or self._moves.busy

    @property
    def ready(self) -> bool:
        """True if motion commands are taken."""
        return self.enabled and not self.error_code and self._state < State.STOPPED

    @property
    def commands_waiting(self) -> int:
        return int(self._moves.busy)

    @property
    def joints(self) -> Joints:
        """As measured [rad]."""
        return self._measured

    @property
    def joint_speeds(self) -> Joints:
        """As commanded [rad/s]."""
        return self._velocity

    @property
    def tcp(self) -> Matrix:
        """The TCP as measured, shape (4, 4)."""
        if self._measured_tcp is None:
            self._measured_tcp = self._kinematics.tcp_matrix(self._measured)
        return self._measured_tcp

    @property
    def tcp_speed_mm_s(self) -> float:
        """As commanded."""
        linear = self._kinematics.jacobian(self._commanded)[:3] @ self._velocity
        return norm(floats(linear)) * 1000.0

    # --- events ---------------------------------------------------------------------------------

    def raise_error(self, code: int) -> None:
        """Stop with error `code`; the first error stays until it is cleaned."""
        if not self.error_code:
            self.error_code = int(code)
        self._halt(State.STOPPED)

    def raise_drive_error(self, joint: int, code: int) -> None:
        """An error of the drive of `joint`, from 1; it stays until the motors are enabled anew."""
        self.drive_codes = tuple(code if n == joint else 0 for n in range(1, 7))
        self._drives_refuse = True
        self.enabled = False
        self.raise_error(DRIVE_ERRORS.start + joint)

    def raise_warning(self, code: int) -> None:
        """Show warning `code`, 0 for none; it stops nothing."""
        self.warning_code = code

    def press_emergency_stop(self) -> None:
        """The red button: error C2, the power of arm and tool is cut."""
        self._emergency_stop = True
        self.error_code = ErrorCode.EMERGENCY_STOP
        self.enabled = False
        self.settings.tool_outputs = 0
        self._halt(State.STOPPED)

    def release_emergency_stop(self) -> None:
        """The error stays until it is cleaned, and the arm needs to be enabled again."""
        self._emergency_stop = False

    # --- commands -------------------------------------------------------------------------------

    def clean_error(self) -> None:
        """Clear the error; the arm stays stopped. The pressed button cannot be cleared."""
        if self._drives_refuse:
            return
        self.drive_codes = (0,) * 6
        self.error_code = ErrorCode.EMERGENCY_STOP if self._emergency_stop else 0

    def enable(self, on: bool) -> None:
        if on and (self._emergency_stop or self.error_code):
            self._drives_refuse &= self._emergency_stop
            return
        self.enabled = on
        if not on:
            self._halt(State.STOPPED)

    def set_state(self, value: int) -> None:
        """Obey a `StateCommand`."""
        if value == StateCommand.READY:
            if self.enabled and not self.error_code:
                self._state = State.STANDBY
        elif value == StateCommand.PAUSE:
            self._pause()
        elif value == StateCommand.STOP:
            self._halt(State.STOPPED)
        else:
            raise CommandError(f"there is no state {value} to go to")

    def set_mode(self, value: int) -> None:
        try:
            self.mode = Mode(value)
        except ValueError as error:
            raise CommandError(f"mode {value} is not modelled") from error
        self.configuration_changed()

    def set_tcp_offset(self, offset: tuple[float, ...]) -> None:
        """`offset`: x, y, z [mm], roll, pitch, yaw [rad] of the TCP in the flange frame."""
        pose = pose_from_mm_rpy(offset)
        self.settings.tcp_offset = offset
        self._kinematics = Lite6Model(pose)
        self._tool = floats(pose.position)
        self._measured_tcp = None
        self.configuration_changed()

    def configuration_changed(self) -> None:
        """Stop and wait for `set_state(0)`; an error keeps its own state."""
        self._halt(State.STOPPED if self.error_code else State.CHANGED)

    def move_joints(self, goal: Joints, speed: float, acceleration: float) -> None:
        """Move to `goal` [rad] at `speed` [rad/s] and `acceleration` [rad/s²]."""
        self._require(Mode.POSITION)
        if self.ready:
            self._moves.command(goal, speed, acceleration)

    def servo_twist(self, twist: Numbers, duration_s: float) -> None:
        """Move with `twist` [m/s, rad/s] for `duration_s`; for ever if that is not positive."""
        self._require(Mode.CARTESIAN_VELOCITY)
        if self._obeys:
            self._twist_servo.command(twist, duration_s, self._now_ns)

    # --- one cycle ------------------------------------------------------------------------------

    def step(self, now_ns: int) -> None:
        """One cycle of 4 ms that ends at `now_ns`; call it every `CYCLE_NS`."""
        following = self._commanded
        if not self._braking and self._obeys:
            try:
                following = self._next_joints(now_ns)
                self._velocity = tuple(
                    (after - before) / CYCLE_S
                    for before, after in zip(self._commanded, following, strict=True)
                )
            except MotionError as fault:
                self.raise_error(fault.code)
        if self._braking:
            following, self._velocity = brake(self._commanded, self._velocity)
            self._braking = any(self._velocity)
        self._drive(following)

    def _next_joints(self, now_ns: int) -> Joints:
        """The joints after one cycle of the mode's servo; MotionError if they may not go there."""
        following: Joints | None = None
        if self.mode is Mode.POSITION:
            following = self._moves.step(self._commanded)
        elif self.mode is Mode.CARTESIAN_VELOCITY:
            following = self._twist_servo.step(self._commanded, self._kinematics, now_ns)
        if following is None:
            return self._commanded
        check_motion(
            self._commanded,
            following,
            self._tool,
            self.settings.boundary if self.settings.fence else None,
            self.settings.self_collision_check,
        )
        return following

    def _drive(self, following: Joints) -> None:
        """Send the joints to the plant and take in what it measured."""
        self._commanded = following
        plant_state = self._plant.step(following, self.settings.closing, CYCLE_NS)
        self._measured = plant_state.joints
        if plant_state.collision:
            self._collide()
        self._measured_tcp = None

    def _collide(self) -> None:
        if self.error_code or not self.enabled or not self.settings.collision_sensitivity:
            return
        self.raise_error(ErrorCode.COLLISION)
        # let go where it stands instead of pressing on
        self._commanded = self._measured
        self._velocity = AT_REST

    # --- stopping -------------------------------------------------------------------------------

    def _halt(self, state: State) -> None:
        """Forget all motion and brake."""
        self._state = state
        if state is State.STOPPED and self.settings.clear_outputs_on_stop:
            self.settings.tool_outputs = 0
        self._braking = True
        self._moves.clear()
        self._twist_servo.clear()

    def _pause(self) -> None:
        """Brake; an unfinished joint move goes on after `set_state(0)`, servo commands do not."""
        if not self.ready:
            return
        self._state = State.PAUSED
        self._braking = True
        self._moves.interrupt()
        self._twist_servo.clear()

    @property
    def _obeys(self) -> bool:
        """True if servos run: ready and not paused."""
        return self.ready and self._state is not State.PAUSED

    def _require(self, mode: Mode) -> None:
        if self.mode is not mode:
            raise CommandError(f"this command belongs to mode {mode.value}")
