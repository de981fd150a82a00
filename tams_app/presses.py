"""Counters of presses where the device is read, so that none is lost between samples."""

from __future__ import annotations

from tams_app.records import Presses

# How far trigger or grip is pulled, 0 to 1: between the two they stay as they were, so that a
# finger that trembles at one of them does not press again and again.
ENGAGE_ABOVE, RELEASE_BELOW = 0.6, 0.4


def hysteresis(value: float, was: bool | None) -> bool | None:
    """Decide with hysteresis whether trigger or grip is down.

    Args:
        value: how far it is pulled, 0 to 1.
        was: before; None if that is not known: then one that is down may be so since long ago.

    Returns:
        True if it is down; None: not known.
    """
    if value <= RELEASE_BELOW:
        return False
    if value >= ENGAGE_ABOVE:
        return True if was is not None else None
    return was


class PressCounter:
    """Counts presses from readings that come faster than samples are taken."""

    def __init__(self) -> None:
        """Start with no presses."""
        self.presses = Presses()
        self._down: tuple[bool | None, ...] = (None,) * 4

    def update(self, grip: float, a: bool, b: bool, menu: bool) -> Presses:
        """Take in a reading; a button that is down in the first one has not been pressed.

        Args:
            grip: how far it is pulled, 0 to 1.
            a: the first button is down.
            b: the second button is down.
            menu: the menu button is down.

        Returns:
            All presses so far, for `ControllerSample.presses`.
        """
        was, last = self._down, self.presses
        self._down = down = (hysteresis(grip, was[0]), a, b, menu)
        more = [now is True and before is False for now, before in zip(down, was, strict=True)]
        if any(more):
            self.presses = Presses(
                last.grip + more[0], last.a + more[1], last.b + more[2], last.menu + more[3]
            )
        return self.presses
