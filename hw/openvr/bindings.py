"""The action manifest and the default bindings that SteamVR reads, as JSON.

`config/steamvr/` holds them for the default mapping and is written by `python -m
hw.openvr.bindings`; a configuration with a mapping of its own gets its own folder.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hw.openvr.components import COMPONENTS, HANDS, RoleMap, configured_role_map
from tams_app.config import CONFIG_DIRECTORY, ControllerConfig

ACTION_SET = "/actions/tams"
HAPTIC_ACTION = f"{ACTION_SET}/out/haptic"
MANIFEST_NAME = "actions.json"
COMMITTED_DIRECTORY = CONFIG_DIRECTORY / "steamvr"

# A vector action takes no button: the grip is read from two actions, of which one is bound.
_INPUT_ACTIONS = {
    "trigger": ("vector1", "mandatory", "Deadman and clutch (hold to move)"),
    "grip": ("vector1", "optional", "Translation or orientation, analog grip"),
    "grip_click": ("boolean", "optional", "Translation or orientation, grip button"),
    "a": ("boolean", "mandatory", "Close the gripper"),
    "b": ("boolean", "mandatory", "Open the gripper"),
    "menu": ("boolean", "mandatory", "Confirm (hold), emergency stop (click)"),
}


def input_action(name: str) -> str:
    """The full name of an input action."""
    return f"{ACTION_SET}/in/{name}"


def manifest() -> dict[str, Any]:
    """The action manifest: what TAMS wants to know, whatever the controller."""
    actions = [
        {"name": input_action(name), "type": kind, "requirement": requirement}
        for name, (kind, requirement, _) in _INPUT_ACTIONS.items()
    ]
    actions.append({"name": HAPTIC_ACTION, "type": "vibration", "requirement": "optional"})
    labels = {input_action(name): label for name, (_, _, label) in _INPUT_ACTIONS.items()}
    return {
        "default_bindings": [
            {"controller_type": kind, "binding_url": _bindings_name(kind)} for kind in COMPONENTS
        ],
        "actions": actions,
        "action_sets": [{"name": ACTION_SET, "usage": "leftright"}],
        "localization": [
            {
                "language_tag": "en_US",
                ACTION_SET: "Teleoperation",
                HAPTIC_ACTION: "Pulses",
                **labels,
            }
        ],
    }


def bindings(controller_type: str, config: ControllerConfig) -> dict[str, Any]:
    """The bindings of both hands' controllers of one type, as SteamVR reads them."""
    sources = [
        source
        for hand in HANDS
        for source in _sources(hand, configured_role_map(controller_type, hand, config))
    ]
    haptics = [{"output": HAPTIC_ACTION, "path": f"/user/hand/{h}/output/haptic"} for h in HANDS]
    return {
        "action_manifest_version": 0,
        "controller_type": controller_type,
        "name": "TAMS",
        "description": "Teleoperation of a Lite 6",
        "category": "steamvr_input",
        "options": {},
        "bindings": {ACTION_SET: {"haptics": haptics, "sources": sources}},
    }


def write(directory: Path, config: ControllerConfig) -> Path:
    """Write manifest and bindings into `directory`; the manifest's path. ConfigError as usual."""
    files = {MANIFEST_NAME: manifest()}
    files |= {_bindings_name(kind): bindings(kind, config) for kind in COMPONENTS}
    directory.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (directory / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return directory / MANIFEST_NAME


def _bindings_name(controller_type: str) -> str:
    return f"bindings_{controller_type}.json"


def _sources(hand: str, roles: RoleMap) -> list[dict[str, Any]]:
    """One entry for each source, with all that is read of it."""
    found: dict[str, dict[str, Any]] = {}
    for role, component in roles.items():
        path = f"/user/hand/{hand}/input/{component.source}"
        source = found.setdefault(path, {"path": path, "mode": component.mode, "inputs": {}})
        if component.mode == "dpad":
            source["parameters"] = {"sub_mode": "click"}
        action = "grip_click" if role == "grip" and not component.is_analog else role
        source["inputs"][component.input] = {"output": input_action(action)}
    return list(found.values())


if __name__ == "__main__":
    write(COMMITTED_DIRECTORY, ControllerConfig())
