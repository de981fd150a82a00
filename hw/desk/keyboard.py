"""The keyboard of the console's window as a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hw.desk.desk_controller import DeskController, Reading
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig
from tams_app.records import ControllerStatus, Presses
from tams_app.runtime.mailbox import Mailbox
from tams_app.units import NS_PER_MS
from tams_app.vectors import Floats3

# By key, the axis and its direction: forward, left, up. The same keys turn about the axis that
# they would tilt the hand over; up and down turn it about the vertical.
_AXES: Mapping[str, tuple[int, float]] = {
    "w": (0, 1.0),
    "s": (0, -1.0),
    "a": (1, 1.0),
    "d": (1, -1.0),
    "r": (2, 1.0),
    "f": (2, -1.0),
}
DEADMAN, MODE, CLOSE, OPEN = "shift", "m", "c", "o"
KEYS = frozenset((*_AXES, DEADMAN, MODE, CLOSE, OPEN))  # that mean something here


@dataclass(frozen=True, slots=True)
class HeldKeys:
    """Which keys are down in the window, told again and again while it lives.

    keys: by the names in `KEYS`. focused: whether the window gets what is typed. t_ns: when the
    window's process said so. presses: how often each key has gone down.
    """

    keys: frozenset[str]
    focused: bool
    t_ns: int
    presses: Mapping[str, int] = field(default_factory=dict)


class KeyboardController(DeskController):
    """A hand that the held keys move; Shift is the deadman.

    `feed` is called with what the window tells, by any thread. A window without focus is a
    controller that is laid down, as is one that has not told anything yet; one that tells nothing
    any more is one that freezes.
    """

    late_ns = 100 * NS_PER_MS  # a window without a graphics card draws between two of its beats

    def __init__(self, config: DeskConfig, rotation: tuple[Floats3, Floats3, Floats3]) -> None:
        super().__init__(config, rotation)
        self._held: Mailbox[HeldKeys] = Mailbox()
        self._started = False

    def start(self) -> None:
        """Listen; the window need not be there yet."""
        self._started = True

    def feed(self, held: HeldKeys) -> None:
        """The keys that are down now."""
        self._held.put(held)

    def reading(self) -> Reading | None:
        held = self._held.latest()
        if not self._started:
            return None
        if held is None:
            return Reading(ControllerStatus.STANDBY, 0)
        if not held.focused:
            return Reading(ControllerStatus.STANDBY, held.t_ns)
        return Reading(ControllerStatus.OK, held.t_ns, deflection_of(held.keys, held.presses))

    def close(self) -> None:
        self._started = False
        self._held = Mailbox()


def deflection_of(keys: frozenset[str], presses: Mapping[str, int]) -> Deflection:
    """What the held keys ask for; opposite keys cancel each other."""
    axes = [0.0, 0.0, 0.0]
    for key in keys & _AXES.keys():
        axis, direction = _AXES[key]
        axes[axis] += direction
    forward, left, up = axes
    return Deflection(
        linear=(forward, left, up),
        angular=(-left, forward, up),
        trigger=float(DEADMAN in keys),
        grip=MODE in keys,
        a=CLOSE in keys,
        b=OPEN in keys,
        presses=Presses(presses.get(MODE, 0), presses.get(CLOSE, 0), presses.get(OPEN, 0)),
    )
