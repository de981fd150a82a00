"""The errors of the Lite 6's controller: what each one means and what to do about it.

After UFACTORY's user manual.
"""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.records import ArmFault


@dataclass(frozen=True, slots=True)
class ControllerError:
    """In a few words each, without a full stop."""

    meaning: str
    remedy: str


_RELEASE = "release the emergency stop"
_RESTART = "switch the control box off and on"
_UNKNOWN = ControllerError("", "look it up in UFACTORY's user manual")

CONTROLLER_ERRORS = {
    1: ControllerError("emergency stop button pressed", _RELEASE),
    2: ControllerError("emergency stop pressed", _RELEASE),
    3: ControllerError("emergency stop of the three-state switch pressed", _RELEASE),
    10: ControllerError("joint motor failed", _RESTART),
    **{10 + n: ControllerError(f"motor of joint {n} failed", _RESTART) for n in range(1, 7)},
    19: ControllerError("gripper does not answer", "check its plug at the flange"),
    21: ControllerError("pose out of reach", "keep away from the edge of the workspace"),
    22: ControllerError("self-collision", "move the arm clear with `home` or by hand guiding"),
    23: ControllerError("joint limit", "move the joint back with `home` or by hand guiding"),
    24: ControllerError("joint too fast", "keep away from stretched and folded wrist poses"),
    25: ControllerError("motion not planned", "move more slowly"),
    28: ControllerError("tool flange does not answer", _RESTART),
    30: ControllerError("joint faster than commanded", "call UFACTORY"),
    31: ControllerError(
        "collision", "remove what it hit and check arm.tcp_load_kg in the configuration"
    ),
    35: ControllerError("safety boundary", "bring the arm back with `home` or by hand guiding"),
    38: ControllerError("wrong joint angle", "press the emergency stop and call UFACTORY"),
    60: ControllerError("arm too fast", "lower limits.max_speed_mm_s"),
}


def arm_fault(code: int) -> ArmFault | None:
    """Error `code` of the controller's report; None for 0."""
    if not code:
        return None
    error = CONTROLLER_ERRORS.get(code, _UNKNOWN)
    meaning = f" ({error.meaning})" if error.meaning else ""
    return ArmFault(int(code), f"C{int(code)}{meaning}: {error.remedy}")


def error_sentence(code: int) -> str:
    """One sentence for error `code`; "" for 0."""
    fault = arm_fault(code)
    return fault.sentence if fault is not None else ""


def standing_error_sentence(code: int) -> str:
    """One sentence for an arm that is found in error `code`, and how to get it out of there."""
    fault = arm_fault(code)
    return (
        f"The arm stands in error {fault.text}; then run `run_tams.py home`, which clears it."
        if fault is not None
        else ""
    )
