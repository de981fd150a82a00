"""Fields of older logs under the names and in the forms of today's records.

A record whose fields were renamed gets one function here, which takes the JSON object as it was
logged and returns it as it would be logged now. It applies wherever the record occurs, also as a
part of another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app.records import ArmState

# Up to 0.1 logs held the controller's own numbers.
_SERVOS = {5: "velocity", 1: "pose"}
_ACTIVITIES = {0: "idle", 1: "moving", 2: "idle", 3: "paused"}


def _arm_state(logged: dict[str, Any]) -> dict[str, Any]:
    """Up to 0.1, `mode`, `state` and `error_code` were what servo, activity and fault are now."""
    if "error_code" not in logged:
        return logged
    code = logged["error_code"]
    return {
        **logged,
        "servo": _SERVOS.get(logged["mode"]),
        "activity": _ACTIVITIES.get(logged["state"], "stopped"),
        "fault": {"code": code, "text": f"C{code}"} if code else None,
    }


UPGRADES: dict[type, Callable[[dict[str, Any]], dict[str, Any]]] = {
    ArmState: _arm_state,
}
