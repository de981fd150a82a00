"""Which component each part of the controller moves, from pressing one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from rich.table import Table

from calibration.frame.asking import repeated
from calibration.frame.fit import BeginAgainError, RefusedError
from calibration.frame.sources import SHOW_EVERY, ButtonSource
from calibration.kit import WizardUI, bar, table
from hw.openvr.components import ROLES, ComponentReading, configured_role_map, role_map
from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.units import NS_PER_S

PRESSED = 0.6  # of the way, as the clutch has it
FREE = 0.3
TIMEOUT_NS = 10 * NS_PER_S
PARTS = {
    "trigger": "the trigger (deadman and clutch)",
    "grip": "the grip (translation or orientation)",
    "a": "A (closes the gripper; X on a left Focus 3, the pad's near edge on a wand)",
    "b": "B (opens the gripper; Y on a left Focus 3, the pad's far edge on a wand)",
    "menu": "the menu (confirms, stops; on a Focus 3 or an Index press the stick)",
}


@dataclass(frozen=True, slots=True)
class ButtonFinding:
    """What the parts of one type of controller turned out to move, and what was believed."""

    controller_type: str
    paths: Mapping[str, str]  # role → component
    believed: Mapping[str, str]

    @property
    def wrong(self) -> tuple[str, ...]:
        """The roles that the mapping in force has on other components."""
        return tuple(role for role in ROLES if self.paths[role] != self.believed[role])


class PressWatch:
    """Waits for exactly one component to be pressed and released."""

    def __init__(self, role: str, taken: Mapping[str, str]) -> None:
        """`taken`: component → the role it has been pressed for."""
        self._role, self._taken = role, taken
        self._since_ns: int | None = None
        self._free = False  # everything was released once
        self._pressed: set[str] = set()

    def take(self, reading: ComponentReading | None, now_ns: int) -> str | None:
        """The component, once released.

        RefusedError if none came or two did, BeginAgainError if it is taken.
        """
        if self._since_ns is None:
            self._since_ns = now_ns
        values = reading.values if reading is not None else {}
        down = {path for path, value in values.items() if value >= PRESSED}
        is_free = reading is not None and all(value <= FREE for value in values.values())
        if not self._free:
            self._free = is_free
        else:
            self._pressed |= down
            if self._pressed and is_free:
                return self._only()
        if now_ns - self._since_ns > TIMEOUT_NS:
            raise self._nothing_came(values)
        return None

    def _only(self) -> str:
        pressed = sorted(self._pressed)
        if len(pressed) > 1:
            raise RefusedError(
                f"{' and '.join(pressed)} were pressed together: press the {self._role} alone."
            )
        path = pressed[0]
        if path in self._taken:
            raise BeginAgainError(
                f"{path} is the {self._taken[path]} already: press another one for {self._role}."
            )
        return path

    def _nothing_came(self, values: Mapping[str, float]) -> RefusedError:
        stuck = sorted(path for path, value in values.items() if value > FREE)
        if not values:
            why = "the controller is switched off, or SteamVR's dashboard is open"
        elif stuck and not self._free:
            why = f"{', '.join(stuck)} never came free"
        elif stuck:
            why = f"{', '.join(stuck)} was not let go"
        else:
            why = "nothing arrived: wake the controller, and press firmly"
        return RefusedError(
            f"Waiting for the {self._role}: {why} (--no-buttons leaves the mapping as it is)."
        )


def settle(
    controller_type: str, hand: str, paths: Mapping[str, str], believed: Mapping[str, str]
) -> ButtonFinding:
    """The finding; BeginAgainError if a component cannot play the part it was pressed for."""
    try:
        role_map(controller_type, hand, paths)
    except ConfigError as error:
        raise BeginAgainError(str(error)) from error
    return ButtonFinding(controller_type, dict(paths), dict(believed))


def ask_buttons(ui: WizardUI, source: ButtonSource, config: Config) -> ButtonFinding:
    """Every part pressed once; begun anew when a component comes for two of them."""
    return repeated(
        ui,
        partial(_press_all, ui, source, config),
        mended=(BeginAgainError,),  # each button was asked for again already
        then=" All the buttons once more.",
    )


def _press_all(ui: WizardUI, source: ButtonSource, config: Config) -> ButtonFinding:
    found: dict[str, str] = {}
    kind = ""
    for role in ROLES:
        ui.print(f"Press and let go {PARTS[role]}.")
        found[role], kind = repeated(ui, partial(_press, ui, source, role, found))
    hand = config.controller.hand
    mapped = configured_role_map(kind, hand, config.controller)
    return settle(kind, hand, found, {role: mapped[role].path for role in ROLES})


def _press(
    ui: WizardUI, source: ButtonSource, role: str, found: Mapping[str, str]
) -> tuple[str, str]:
    """The component that is pressed for `role`, and the type of the controller."""
    source.ask(role)
    watch, count = PressWatch(role, {path: taken for taken, path in found.items()}), 0
    while True:
        now_ns, reading = source.next()
        path = watch.take(reading, now_ns)
        if path is not None and reading is not None:
            return path, reading.controller_type
        count += 1
        if count % SHOW_EVERY == 0:
            ui.show(_button_table(reading, role, found))


def _button_table(reading: ComponentReading | None, role: str, found: Mapping[str, str]) -> Table:
    """Every component with how far it is pressed, and the part it was found to play."""
    values = reading.values if reading else {}
    roles = {path: role for role, path in found.items()}
    rows = [(path, bar(value), roles.get(path, "")) for path, value in values.items()]
    return table(rows, ("component", "pressed", "plays"), f"Press and let go {PARTS[role]}")


def finding_table(finding: ButtonFinding) -> Table:
    """What each part moves, and what was believed."""
    verdicts = {role: "put right" if role in finding.wrong else "as it was" for role in ROLES}
    rows = [(role, finding.paths[role], finding.believed[role], verdicts[role]) for role in ROLES]
    title = f"Buttons of {finding.controller_type}"
    return table(rows, ("part", "found", "in force", ""), title)
