"""Fields of older logs under the names and in the forms of today's records.

A record whose fields were renamed gets one function here, which takes the JSON object as it was
logged and returns it as it would be logged now. It applies wherever the record occurs, also as a
part of another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app.records import FrameQuality


def _frame_quality(logged: dict[str, Any]) -> dict[str, Any]:
    """Up to 0.1, `damaged` was what `incomplete` is now."""
    if "damaged" not in logged:
        return logged
    return {**logged, "incomplete": logged["damaged"]}


UPGRADES: dict[type, Callable[[dict[str, Any]], dict[str, Any]]] = {
    FrameQuality: _frame_quality,
}
