"""The errors of the Lite 6's controller: what each one means and what to do about it.

After UFACTORY's user manual.
"""

from __future__ import annotations

from collections.abc import Sequence

from hw.lite6.codes import DRIVE_ERRORS
from tams_app.records import ArmFault

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
