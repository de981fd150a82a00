"""Numbers of the Lite 6 controller, for its driver and for the model of it.

Sources: `xarm/core/config/x_config.py`, `x_code.py` and `xarm/x3/code.py` of the SDK, FINDINGS 8.
"""

from __future__ import annotations

from enum import IntEnum

from tams_app.records import ArmFault

AXES, LITE6_TYPE = 6, 9  # as the version register and the reports tell them


class Register(IntEnum):
    """Command registers of the control connection."""

    GET_VERSION = 1
    GET_ROBOT_SN = 2
    MOTION_ENABLE = 11
    SET_STATE = 12
    GET_STATE = 13
    GET_COMMAND_COUNT = 14
    GET_ERROR = 15
    CLEAN_ERROR = 16
    CLEAN_WARNING = 17
    SET_MODE = 19
    MOVE_JOINT = 23
    SET_TCP_OFFSET = 35
    SET_LOAD = 36
    SET_COLLISION_SENSITIVITY = 37
    GET_TCP_POSE = 41
    GET_JOINTS = 42
    SET_BOUNDARY = 52
    GET_REDUCED_STATE = 53
    SET_FENCE = 59
    SET_SELF_COLLISION_CHECK = 77
    SET_CARTESIAN_VELOCITY = 82
    GET_TCP_POSE_AA = 91
    MOVE_SERVO_CARTESIAN_AA = 93
    TOOL_GPIO_WRITE = 127
    TOOL_GPIO_READ = 128


class ReplyBit(IntEnum):
    """Bits of the status byte in every reply (`check_private_protocol` of the SDK)."""

    INVALID = 0x08  # the request was not understood
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


class Mode(IntEnum):
    """The modes that TAMS uses, as they are commanded and reported."""

    POSITION = 0
    SERVO = 1
    CARTESIAN_VELOCITY = 5


class StateCommand(IntEnum):
    """What register 12, `set_state`, takes: other numbers than the reports hold (`State`)."""

    READY = 0  # resumes what was paused
    PAUSE = 3
    STOP = 4


class State(IntEnum):
    """What the controller reports that it is doing; STOPPED and CHANGED need `READY` to move."""

    MOVING = 1
    STANDBY = 2
    PAUSED = 3
    STOPPED = 4
    CHANGED = 5  # a mode or a setting was changed


class ErrorCode(IntEnum):
    """Controller errors that the model raises by itself; `errors.py` has them all in words."""

    EMERGENCY_STOP = 2
    KINEMATIC = 21
    SELF_COLLISION = 22
    JOINT_LIMIT = 23
    JOINT_OVERSPEED = 24
    COLLISION = 31
    BOUNDARY = 35
    LINEAR_OVERSPEED = 60


class Code(IntEnum):
    """Return codes of SDK calls that are told apart here."""

    DISCONNECTED = -1
    OK = 0
    ERROR = 1  # the controller is in an error
    WARNING = 2
    TIMEOUT = 3
    NOT_SENT = 8
    NOT_READY = 9
    INVALID = 10


# Return codes that mean: nothing gets through. The others are answers.
NOTHING_GETS_THROUGH = frozenset({Code.DISCONNECTED, Code.NOT_SENT, Code.TIMEOUT})


def return_code_sentence(code: int, call: str) -> str:
    """One sentence for a `code` other than 0 that the SDK returned for `call`."""
    if code in (Code.DISCONNECTED, Code.NOT_SENT):
        return f"The connection to the arm is lost ({call}); check power and cable, then confirm."
    if code == Code.TIMEOUT:
        return f"The arm does not answer ({call}); check the network between here and the arm."
    if code == Code.NOT_READY:
        return f"The arm is stopped and refuses to move ({call}); arm it again."
    if code == Code.ERROR:
        return f"The arm is in an error ({call}); clear it and arm again."
    return f"The arm refused {call} with code {code}; restart its control box if this goes on."


_RELEASE = "release the emergency stop"
_RESTART = "switch the control box off and on"
_UNKNOWN = ("", "look it up in UFACTORY's user manual")

# meaning and remedy, in a few words each, without a full stop
CONTROLLER_ERRORS = {
    1: ("emergency stop button pressed", _RELEASE),
    2: ("emergency stop pressed", _RELEASE),
    3: ("emergency stop of the three-state switch pressed", _RELEASE),
    10: ("joint motor failed", _RESTART),
    **{10 + n: (f"motor of joint {n} failed", _RESTART) for n in range(1, 7)},
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


def arm_fault(code: int) -> ArmFault | None:
    """Error `code` of the controller's report; None for 0."""
    if not code:
        return None
    meaning, remedy = CONTROLLER_ERRORS.get(code, _UNKNOWN)
    named = f"C{int(code)} ({meaning})" if meaning else f"C{int(code)}"
    return ArmFault(int(code), f"{named}: {remedy}")


def error_sentence(code: int) -> str:
    """One sentence for error `code`; "" for 0."""
    fault = arm_fault(code)
    return fault.sentence if fault is not None else ""


def standing_error_sentence(code: int) -> str:
    """One sentence for an arm that is found in error `code`, and how to get it out of there."""
    fault = arm_fault(code)
    if fault is None:
        return ""
    return f"The arm stands in error {fault.text}; then run `run_tams.py home`, which clears it."
