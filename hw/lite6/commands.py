"""Commands of the Lite 6 and the meaning of its reports, for the driver and its simulation.

Hard limits, errors and what to do about them are those of UFACTORY's user manual; joint ranges are
the SDK's table for axis 6, type 9 (`xarm/core/config/x_config.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hw.arm import ArmLimits, TcpBoundary
from hw.lite6.protocol import DRIVE_ERRORS, Mode, State
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmFault, LinkFault, ServoMode, Twist, Vector
from tams_app.vectors import norm

LIMITS = ArmLimits(
    joint_lower_deg=(-360.0, -150.0, -3.5, -360.0, -124.0, -360.0),
    joint_upper_deg=(360.0, 150.0, 300.0, 360.0, 124.0, 360.0),
    joint_speed_rad_s=math.pi,
    tcp_speed_mm_s=500.0,
    tcp_acceleration_mm_s2=50_000.0,
    reach_mm=440.0,
    # FINDINGS 8: 200, then 87 and 227.6 at a right angle, then 61.5
    shoulder_mm=243.3,
    stretched_mm=200.0 + math.hypot(87.0, 227.6) + 61.5,
    # ours: below 75 °C, seen without error S15 (xArm-Python-SDK issue 106), as none is published
    hot_motor_c=70.0,
)
_SERVOS = {Mode.CARTESIAN_VELOCITY.value: ServoMode.VELOCITY, Mode.SERVO.value: ServoMode.POSE}
_ACTIVITIES = {
    0: Activity.IDLE,
    State.MOVING.value: Activity.MOVING,
    State.STANDBY.value: Activity.IDLE,
    State.PAUSED.value: Activity.PAUSED,
}
NO_FAILURE = ("", LinkFault.NONE)  # of the command link
NOT_CONNECTED = "The arm is not connected; connect it first."
OUTPUTS_DIFFER = "The gripper's outputs are not what was commanded; check its plug at the flange."
GRIPPER_ATTEMPTS = 3
READY_ACCELERATION_RAD_S2 = 1.0  # of a move to joints
_FARTHEST_MM = 9999  # registers 52 and 53 hold more; nothing of the arm gets there
_MM_PER_M = 1000.0


def activity_of(state: int) -> Activity:
    """The meaning of a reported state; STOPPED, also where it is unknown, until made ready."""
    return _ACTIVITIES.get(state, Activity.STOPPED)


def servo_of(mode: int) -> ServoMode | None:
    """The servo that a reported mode stands for; None for other modes."""
    return _SERVOS.get(mode)


def boundary_edges(boundary: TcpBoundary) -> list[int]:
    """As registers 52 and 53 order them: x max, x min, y max, y min, z max, z min [mm]."""
    pairs = zip(boundary.upper_mm, boundary.lower_mm, strict=True)
    return [max(-_FARTHEST_MM, min(_FARTHEST_MM, edge)) for pair in pairs for edge in pair]


def checked_goal(joints: list[float], speed: float) -> Vector:
    """`joints` [rad] as an array, shape (6,); DeviceError if the arm may not move there so."""
    goal = np.array(joints, dtype=np.float64)
    lower, upper = np.radians(LIMITS.joint_lower_deg), np.radians(LIMITS.joint_upper_deg)
    if goal.shape != (6,) or not ((goal >= lower) & (goal <= upper)).all():  # false for NaN
        raise DeviceError("The joint angles to move to are outside the Lite 6's limits.")
    if not 0 < speed <= LIMITS.joint_speed_rad_s:
        raise DeviceError(f"A joint speed of {speed:g} rad/s is outside the Lite 6's limits.")
    return goal


def twist_refusal(twist: Twist) -> str:
    """The reason why this twist is not sent, "" if it may be."""
    speed_mm_s = norm(twist.linear) * _MM_PER_M
    turn_rad_s = norm(twist.angular)
    if not speed_mm_s <= LIMITS.tcp_speed_mm_s:  # also true for NaN
        return f"A velocity of {speed_mm_s:g} mm/s was refused; please report this error."
    if not turn_rad_s <= LIMITS.joint_speed_rad_s:
        return f"A turn of {turn_rad_s:g} rad/s was refused; please report this error."
    return ""


_RELEASE = "release the emergency stop"
_RESTART = "switch the control box off and on"
_REPOWER = "press and release the emergency stop, or call UFACTORY"
_UNKNOWN = ("", "look it up in UFACTORY's user manual")
_OVERHEATED = 15  # of a drive's own errors (manual of UFACTORY Studio, 12.2)

# meaning and remedy, in a few words each, without a full stop
CONTROLLER_ERRORS = {
    1: ("emergency stop button pressed", _RELEASE),
    2: ("emergency stop pressed", _RELEASE),
    3: ("emergency stop of the three-state switch pressed", _RELEASE),
    10: ("joint motor failed", _REPOWER),
    **{10 + n: (f"motor of joint {n} failed", _REPOWER) for n in range(1, 7)},
    19: ("gripper does not answer", "check its plug at the flange"),
    21: ("pose out of reach", "keep away from the edge of the workspace"),
    22: ("self-collision", "move the arm clear with `home` or by hand guiding"),
    23: ("joint limit", "move the joint back with `home` or by hand guiding"),
    24: ("joint too fast", "keep away from stretched and folded wrist poses"),
    25: ("motion not planned", "move more slowly"),
    28: ("tool flange does not answer", _RESTART),
    30: ("joint faster than commanded", "call UFACTORY"),
    31: ("collision", "remove what it hit and check arm.tcp_load_kg in the configuration"),
    35: ("safety boundary", "bring the arm back with `home` or by hand guiding"),
    38: ("wrong joint angle", "press the emergency stop and call UFACTORY"),
    60: ("arm too fast", "lower limits.max_speed_mm_s"),
}


def arm_fault(code: int, drive_codes: Sequence[int] = ()) -> ArmFault | None:
    """Error `code` of the controller's report, and those of the joints' drives; None for 0."""
    if not code:
        return None
    meaning, remedy = CONTROLLER_ERRORS.get(code, _UNKNOWN)
    drive = max(drive_codes, default=0) if code in DRIVE_ERRORS else 0
    if drive == _OVERHEATED:
        meaning, remedy = f"{meaning}, S{drive} overheated", "let the arm cool down"
    elif drive:
        meaning = f"{meaning}, S{drive}"
    named = f"C{int(code)} ({meaning})" if meaning else f"C{int(code)}"
    return ArmFault(int(code), f"{named}: {remedy}")


def error_sentence(code: int, drive_codes: Sequence[int] = ()) -> str:
    """One sentence for error `code`; "" for 0."""
    fault = arm_fault(code, drive_codes)
    return fault.sentence if fault is not None else ""


def standing_error_sentence(code: int) -> str:
    """One sentence for an arm that is found in error `code`, and how to get it out of there."""
    fault = arm_fault(code)
    if fault is None:
        return ""
    return f"The arm stands in error {fault.text}; then run `run_tams.py home`, which clears it."
