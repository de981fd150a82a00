"""Numbers of the Lite 6 controller, for its driver and for the model of it.

Sources: `xarm/core/config/x_config.py`, `x_code.py` and `xarm/x3/code.py` of the SDK, FINDINGS 8.
"""

from __future__ import annotations

from enum import IntEnum

AXES, LITE6_TYPE = 6, 9  # as the version register and the reports give them


class Register(IntEnum):
    """Command registers of the control connection."""

    GET_VERSION = 1
    MOTION_ENABLE = 11
    SET_STATE = 12
    GET_STATE = 13
    GET_ERROR = 15
    CLEAN_ERROR = 16
    CLEAN_WARNING = 17
    SET_MODE = 19
    MOVE_JOINT = 23
    SET_TCP_OFFSET = 35
    SET_LOAD = 36
    SET_COLLISION_SENSITIVITY = 37
    GET_TCP_POSE = 41
    SET_BOUNDARY = 52
    SET_FENCE = 59
    SET_SELF_COLLISION_CHECK = 77
    SET_CARTESIAN_VELOCITY = 82
    TOOL_GPIO_WRITE = 127
    TOOL_GPIO_READ = 128


class ReplyBit(IntEnum):
    """Bits of the status byte in every reply (`check_private_protocol` of the SDK)."""

    INVALID = 0x08  # the request was not understood
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


class Mode(IntEnum):
    """The modes that TAMS knows, as they are commanded and reported."""

    POSITION = 0
    SERVO = 1
    CARTESIAN_VELOCITY = 5


class StateCommand(IntEnum):
    """Commands for register 12, `set_state`: other numbers than the reports hold (`State`)."""

    READY = 0  # resumes what was paused
    PAUSE = 3
    STOP = 4


class State(IntEnum):
    """States that the controller reports; STOPPED and CHANGED need `READY` to move."""

    MOVING = 1
    STANDBY = 2
    PAUSED = 3
    STOPPED = 4
    CHANGED = 5  # a mode or a setting was changed


class ErrorCode(IntEnum):
    """Controller errors that the model raises by itself; `commands.py` has them all in words."""

    EMERGENCY_STOP = 2
    KINEMATIC = 21
    SELF_COLLISION = 22
    JOINT_LIMIT = 23
    JOINT_OVERSPEED = 24
    COLLISION = 31
    BOUNDARY = 35


# 10 plus the joint; they stay until the motors are enabled anew (UFACTORY in xarm_ros issue 114)
DRIVE_ERRORS = range(10, 18)


class Code(IntEnum):
    """Return codes of SDK calls that are distinguished here."""

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
