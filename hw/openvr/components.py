"""The buttons of the supported controllers: their components, roles and readings.

SteamVR's names. Left out on purpose: the system button, which SteamVR keeps, and the trigger's
click, which cannot be pressed without the deadman. Nothing here was checked against SteamVR: names
and modes follow its published drivers and bindings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from tams_app.config import ControllerConfig
from tams_app.errors import ConfigError

HANDS = ("left", "right")
ROLES = ("trigger", "grip", "a", "b", "menu")
_ANALOG_INPUTS = frozenset({"pull", "force"})


@dataclass(frozen=True, slots=True)
class Axis:
    """Controller state: the x of an axis."""

    number: int


@dataclass(frozen=True, slots=True)
class Button:
    """Controller state: a bit of the pressed buttons."""

    number: int


class PadSide(Enum):
    """Controller state: the trackpad (axis 0) pressed towards x, y."""

    NORTH = (0, 1)
    SOUTH = (0, -1)
    EAST = (1, 0)
    WEST = (-1, 0)


StatePlace: TypeAlias = Axis | Button | PadSide


@dataclass(frozen=True, slots=True)
class Component:
    """`path` is source/input, as in the configuration; `mode` is how SteamVR's bindings use it.

    `place`: where the controller state has it, None if it has no place there.
    """

    path: str
    mode: str
    place: StatePlace | None

    @property
    def source(self) -> str:
        return self.path.partition("/")[0]

    @property
    def input(self) -> str:
        return self.path.partition("/")[2]

    @property
    def is_analog(self) -> bool:
        return self.input in _ANALOG_INPUTS


RoleMap: TypeAlias = Mapping[str, Component]  # role → component


@dataclass(frozen=True, slots=True)
class ComponentReading:
    """All that can be read of a controller, whatever part it plays: path → 0..1."""

    controller_type: str
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class ButtonReading:
    """One complete reading: trigger and grip 0..1."""

    trigger: float = 0.0
    grip: float = 0.0
    a: bool = False
    b: bool = False
    menu: bool = False


_PAD_SIDES = tuple(Component(f"trackpad/{s.name.lower()}", "dpad", s) for s in PadSide)
_FOCUS3_BOTH = (
    Component("trigger/pull", "trigger", Axis(1)),
    Component("grip/pull", "trigger", Axis(2)),
    Component("joystick/click", "joystick", Button(32)),
)
_FOCUS3_LEFT = (
    Component("x/click", "button", Button(7)),
    Component("y/click", "button", Button(1)),
    Component("application_menu/click", "button", None),  # the state's menu bit is Y
)
_FOCUS3_RIGHT = (
    Component("a/click", "button", Button(7)),
    Component("b/click", "button", Button(1)),
)
_WAND = (
    Component("trigger/pull", "trigger", Axis(1)),
    Component("grip/click", "button", Button(2)),
    *_PAD_SIDES,
    Component("application_menu/click", "button", Button(1)),
)
_INDEX = (
    Component("trigger/pull", "trigger", Axis(1)),
    Component("grip/force", "force_sensor", Axis(2)),  # its pull is 1 as soon as it is held
    Component("a/click", "button", Button(2)),  # k_EButton_IndexController_A
    Component("b/click", "button", Button(1)),
    Component("thumbstick/click", "joystick", Button(35)),
)

# controller type → hand → what there is
COMPONENTS: dict[str, dict[str, tuple[Component, ...]]] = {
    "vive_focus3_controller": {
        "left": _FOCUS3_BOTH + _FOCUS3_LEFT,
        "right": _FOCUS3_BOTH + _FOCUS3_RIGHT,
    },
    "vive_controller": {"left": _WAND, "right": _WAND},
    "knuckles": {"left": _INDEX, "right": _INDEX},
}

# controller type → hand → paths of ROLES. On the Focus 3 only the left controller has a menu
# button that applications may use, so a press of the joystick is the menu on either hand.
_DEFAULTS: dict[str, dict[str, tuple[str, ...]]] = {
    "vive_focus3_controller": {
        "left": ("trigger/pull", "grip/pull", "x/click", "y/click", "joystick/click"),
        "right": ("trigger/pull", "grip/pull", "a/click", "b/click", "joystick/click"),
    },
    "vive_controller": dict.fromkeys(
        HANDS,
        (
            "trigger/pull",
            "grip/click",
            "trackpad/south",
            "trackpad/north",
            "application_menu/click",
        ),
    ),
    "knuckles": dict.fromkeys(
        HANDS, ("trigger/pull", "grip/force", "a/click", "b/click", "thumbstick/click")
    ),
}


def role_map(controller_type: str, hand: str, overrides: Mapping[str, str]) -> RoleMap:
    """The component of each role, with `overrides` (role → path) over the type's defaults.

    ConfigError if the type has no such component, if it cannot play the role, or if two roles
    share one.
    """
    key = f"controller.mapping.{controller_type}"
    there = {component.path: component for component in COMPONENTS[controller_type][hand]}
    paths = dict(zip(ROLES, _DEFAULTS[controller_type][hand], strict=True)) | dict(overrides)
    taken: dict[str, str] = {}
    for role, path in paths.items():
        if path not in there:
            raise ConfigError(
                f"{key}.{role}: the {hand} controller has no {path}, but {', '.join(there)}."
            )
        if there[path].is_analog and role not in ("trigger", "grip"):
            raise ConfigError(f"{key}.{role}: {path} is analog; choose a button.")
        if not there[path].is_analog and role == "trigger":
            raise ConfigError(f"{key}.{role}: the deadman must be analog; {path} is a button.")
        if path in taken:
            raise ConfigError(f"{key}: {path} cannot be both {taken[path]} and {role}.")
        taken[path] = role
    return {role: there[path] for role, path in paths.items()}


def configured_role_map(controller_type: str, hand: str, config: ControllerConfig) -> RoleMap:
    """`role_map` with the overrides of `config`, which are meant for the hand it names."""
    mapping = {str(known): mapping for known, mapping in config.mapping.items()}
    if controller_type not in mapping or hand != config.hand:
        return role_map(controller_type, hand, {})
    return role_map(controller_type, hand, mapping[controller_type].model_dump(exclude_none=True))
