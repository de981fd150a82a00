"""What the numbers of the Lite 6 controller mean, and what to do about them.

Error codes after UFACTORY's user manual; return codes after the SDK's `x3/code.py`.
"""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """The controller modes that TAMS uses."""

    POSITION = 0
    SERVO = 1
    CARTESIAN_VELOCITY = 5


class State(IntEnum):
    """`set_state` takes 0 (ready), 3 and 4; reports hold the others."""

    READY = 0
    MOVING = 1
    STANDBY = 2
    PAUSED = 3
    STOPPED = 4
    CHANGED = 5  # a mode or a setting was changed; needs READY


MAY_MOVE = frozenset({State.READY, State.MOVING, State.STANDBY})


class Code(IntEnum):
    """Return codes of SDK calls that are told apart here."""

    DISCONNECTED = -1
    OK = 0
    ERROR = 1  # the controller is in an error
    WARNING = 2
    TIMEOUT = 3
    NOT_SENT = 8
    NOT_READY = 9


# Return codes that mean: nothing gets through. The others are answers.
NOTHING_GETS_THROUGH = frozenset({Code.DISCONNECTED, Code.NOT_SENT, Code.TIMEOUT})


CONTROLLER_ERRORS = {
    1: "the emergency stop button is pressed; release it",
    2: "the emergency stop is pressed; release it",
    3: "the emergency stop of the three-state switch is pressed; release it",
    10: "a joint motor failed; switch the control box off and on",
    **{10 + n: f"joint {n}'s motor failed; switch the control box off and on" for n in range(1, 7)},
    19: "the gripper does not answer; check its plug at the flange",
    21: "the pose cannot be reached; move away from the edge of the workspace",
    22: "the arm would hit itself; move it clear by hand guiding",
    23: "a joint is at its limit; move it back by hand guiding",
    24: "a joint would be too fast; keep away from stretched and folded wrist poses",
    25: "the motion could not be planned; move more slowly",
    28: "the tool flange does not answer; switch the control box off and on",
    30: "a joint was faster than commanded; call UFACTORY",
    31: "the arm met resistance; remove what it hit and check tcp_load_kg in the configuration",
    35: "the arm is at the edge of its workspace; bring it back with `home` or by hand guiding",
    38: "a joint angle is wrong; press the emergency stop and call UFACTORY",
    60: "the arm would be too fast; lower limits.max_speed_mm_s",
}


def controller_error_sentence(code: int) -> str:
    """One sentence for controller error `code` (the number in the report's error field)."""
    meaning = CONTROLLER_ERRORS.get(code, "look it up in UFACTORY's user manual")
    return f"The arm stopped with error C{code}: {meaning}."


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
