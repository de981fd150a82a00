"""Numbers of the Lite 6 controller: registers, modes, states, errors and reply bits.

Sources: xarm/core/config/x_config.py and x_code.py of the SDK, FINDINGS 8.
"""

from __future__ import annotations

from enum import IntEnum


class Register(IntEnum):
    """The command registers that the model serves."""

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
    MOVE_SERVO_CARTESIAN = 30
    SET_TCP_OFFSET = 35
    SET_LOAD = 36
    SET_COLLISION_SENSITIVITY = 37
    GET_TCP_POSE = 41
    GET_JOINTS = 42
    SET_BOUNDARY = 52
    GET_REDUCED_STATE = 53
    SET_FENCE = 59
    SET_COLLISION_REBOUND = 60
    SET_SELF_COLLISION_CHECK = 77
    SET_SIMULATION_ROBOT = 79
    SET_CARTESIAN_VELOCITY = 82
    GET_TCP_POSE_AA = 91
    MOVE_SERVO_CARTESIAN_AA = 93
    TOOL_GPIO_WRITE = 127
    TOOL_GPIO_READ = 128


class ReplyBit(IntEnum):
    """Bits of the status byte in every reply (check_private_protocol of the SDK)."""

    INVALID = 0x08
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


class Mode(IntEnum):
    """How commands are executed."""

    POSITION = 0
    SERVO = 1
    CARTESIAN_VELOCITY = 5


class State(IntEnum):
    """What the controller is doing; 4 and 5 refuse motion until `set_state(0)`."""

    MOVING = 1
    READY = 2
    PAUSED = 3
    STOPPED = 4
    CHANGED = 5  # mode or configuration changed


class ErrorCode(IntEnum):
    """The controller errors that the model raises by itself."""

    EMERGENCY_STOP = 2
    KINEMATIC = 21
    SELF_COLLISION = 22
    JOINT_LIMIT = 23
    JOINT_OVERSPEED = 24
    COLLISION = 31
    BOUNDARY = 35
    LINEAR_OVERSPEED = 60


class MotionError(Exception):
    """Motion that the controller refuses; it stops with this error code."""

    def __init__(self, code: ErrorCode) -> None:
        super().__init__(f"controller error C{code.value}: {code.name.lower()}")
        self.code = code


class CommandError(Exception):
    """A request the controller cannot make sense of; it changes nothing."""
