"""What reaches the control loop from outside: confirmations, emergency stops, faults."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.teleop.safety import Reason


@dataclass(frozen=True, slots=True)
class Pending:
    """What has come in since the last tick, and the faults that stay until the session ends."""

    confirm: bool
    estop: bool
    faults: tuple[Reason, ...]


class Signals:
    """Set from any thread, taken once per control tick.

    Plain attributes on purpose: a signal handler must never wait for a lock.
    """

    def __init__(self) -> None:
        self._confirm = False
        self._estop = False
        self._faults: dict[Reason, None] = {}
        self._trips: dict[Reason, None] = {}

    def confirm(self) -> None:
        """The operator agrees: arm, or clear a fault."""
        self._confirm = True

    def estop(self) -> None:
        """Emergency stop."""
        self._estop = True

    def fault(self, reason: Reason) -> None:
        """Something the arm must not move without is gone, until the session ends."""
        self._faults[reason] = None  # one operation: two threads never lose one of two faults

    def trip(self, reason: Reason) -> None:
        """Something that stopped the arm once; the operator may confirm it away."""
        self._trips[reason] = None

    def take(self) -> Pending:
        """Everything pending; confirmations and stops are used up by this."""
        trips = tuple(self._trips)
        pending = Pending(self._confirm, self._estop, (*self._faults, *trips))
        # only what was seen is used up: a stop that comes in between is taken by the next tick
        if pending.confirm:
            self._confirm = False
        if pending.estop:
            self._estop = False
        for reason in trips:
            del self._trips[reason]
        return pending
