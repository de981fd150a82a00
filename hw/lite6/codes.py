"""What the numbers of the Lite 6 controller mean, and what to do about them.

Return codes after the SDK's `x3/code.py`; the controller's errors are in tams_app/lite6_errors.py.
"""

from __future__ import annotations

from enum import IntEnum

from tams_app.lite6_errors import describe_arm_error


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


def controller_error_sentence(code: int) -> str:
    """One sentence for controller error `code` (the number in the report's error field)."""
    return f"The arm stopped with error {describe_arm_error(code)}."


def standing_error_sentence(code: int) -> str:
    """One sentence for an arm that is found in error `code`, and how to get it out of there."""
    return (
        f"The arm stands in error {describe_arm_error(code)}; "
        "then run `run_tams.py home`, which clears it."
    )


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
