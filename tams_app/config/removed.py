"""What earlier versions had, and what takes its place."""

from __future__ import annotations

from typing import Any

_METRICS = (
    "there are no figures for Prometheus any more: Foxglove shows them while a session runs "
    "(--foxglove), summary.json has them afterwards; leave it out"
)
_PADS = (
    "TAMS does not read gamepads and 3D mice any more: use the keyboard, or install a driver "
    "(entry point `tams.controllers`)"
)
_CAMERAS = (
    "`calibrate cameras` measures which camera is which, latency, lens and mount only: focus in a "
    "session's window, set cameras.VIEW.exposure_us, and see frame rates in summary.json"
)
_MARKS = "mark each LOG with `replay LOG --mark`, and give the marked ones with --from"
REMOVED = {
    "--metrics": _METRICS,
    "recording.metrics": _METRICS,
    "gamepad": _PADS,
    "spacemouse": _PADS,
    "controller.desk.dead_zone": _PADS,
    "controller.desk.name": _PADS,
    "controller.desk.wireless": _PADS,
    "controller.desk.unchanged_ms": _PADS,
    "focus": _CAMERAS,
    "exposure": _CAMERAS,
    "rate": _CAMERAS,
    "calibrate cameras --from": _CAMERAS,
    "calibrate phases --mark": _MARKS,
    "calibrate phases --goal-height-mm": _MARKS,
    "calibrate phases --yes": "it writes without a question; leave it out",
    "calibrate phases --figure": "its figures are in the file that it writes; leave it out",
    "calibrate phases --picture": "its figures are in the file that it writes; leave it out",
}
"""By key, option (of one command, or of several) or word for a key or an option."""
_DEFAULTS = {  # other than null: the configurations that sessions have stored hold them
    "recording.metrics": "",
    "controller.desk.dead_zone": 0.12,
    "controller.desk.name": "",
    "controller.desk.unchanged_ms": 500.0,
}


def removed_keys(content: dict[str, Any]) -> dict[str, str]:
    """The removed keys that ask for something, and what takes their places."""
    return {
        key: instead
        for key, instead in REMOVED.items()
        if _at(content, key) not in (None, _DEFAULTS.get(key))
    }


def without_removed(content: Any) -> Any:
    """The content without any removed key."""
    for key in REMOVED:
        content = _without(content, key)
    return content


def _at(content: Any, key: str) -> Any:
    for part in key.split("."):
        content = content.get(part) if isinstance(content, dict) else None
    return content


def _without(content: Any, key: str) -> Any:
    first, _, rest = key.partition(".")
    if not isinstance(content, dict) or first not in content:
        return content
    others = {name: value for name, value in content.items() if name != first}
    return others | {first: _without(content[first], rest)} if rest else others
