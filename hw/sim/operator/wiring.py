"""What comes of the fingers' presses: through the components they move, and the mapping."""

from __future__ import annotations

from collections.abc import Mapping

from hw.openvr.components import (
    COMPONENTS,
    ROLES,
    ComponentReading,
    RoleMap,
    configured_role_map,
    role_map,
)
from tams_app.config import Config
from tams_app.errors import ConfigError


class Wiring:
    """A controller whose parts may move other components than the mapping believes."""

    def __init__(self, controller_type: str, hand: str, moves: RoleMap, plays: RoleMap) -> None:
        """`moves`: the component that a press of each part moves; `plays`: the mapping's."""
        self._controller_type = controller_type
        self._paths = tuple(component.path for component in COMPONENTS[controller_type][hand])
        self._moves, self._plays = moves, plays

    def reading(self, pressed: Mapping[str, float]) -> ComponentReading:
        """Every component while the parts (`ROLES`) are pressed so far, 0..1."""
        values = dict.fromkeys(self._paths, 0.0)
        for role, value in pressed.items():
            component = self._moves[role]
            values[component.path] = value if component.is_analog else float(value > 0.5)
        return ComponentReading(self._controller_type, values)

    def roles(self, reading: ComponentReading) -> dict[str, float]:
        """What the mapping makes of a reading: role → 0..1."""
        return {role: reading.values[self._plays[role].path] for role in ROLES}


def rig_wiring(config: Config) -> Wiring:
    """The rig's controller, mapped as configured; ConfigError if either mapping does not fit it."""
    rig, hand = config.rig, config.controller.hand
    try:
        moves = role_map(rig.controller_type, hand, rig.wiring.model_dump(exclude_none=True))
    except ConfigError as error:
        raise ConfigError(f"rig.wiring: {error}") from error
    plays = configured_role_map(rig.controller_type, hand, config.controller)
    return Wiring(rig.controller_type, hand, moves, plays)
