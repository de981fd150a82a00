"""Fields of older logs under the names and in the forms of today's records.

A record whose fields were renamed gets one function here, which takes the JSON object as it was
logged and returns it as it would be logged now. It applies wherever the record occurs, also as a
part of another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app.records import Activity, ArmState, FrameQuality, ServoMode

# Up to 0.1 an arm's state was told in the numbers of the only controller there was.
_ACTIVITIES = {0: Activity.IDLE, 1: Activity.MOVING, 2: Activity.IDLE, 3: Activity.PAUSED}
_SERVO_MODES = {1: ServoMode.POSE, 5: ServoMode.VELOCITY}


def _arm_state(logged: dict[str, Any]) -> dict[str, Any]:
    if "error_code" not in logged:
        return logged
    code = logged["error_code"]
    return {
        **logged,
        "activity": _ACTIVITIES.get(logged["state"], Activity.STOPPED),
        "servo": _SERVO_MODES.get(logged["mode"]),
        "fault": {"code": code, "text": f"C{code}"} if code else None,
    }


def _frame_quality(logged: dict[str, Any]) -> dict[str, Any]:
    """Up to 0.1, `damaged` was what `concealed` is now."""
    if "damaged" not in logged:
        return logged
    return {**logged, "concealed": logged["damaged"]}


UPGRADES: dict[type, Callable[[dict[str, Any]], dict[str, Any]]] = {
    ArmState: _arm_state,
    FrameQuality: _frame_quality,
}
