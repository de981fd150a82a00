"""The pace at which something is sent on."""

from __future__ import annotations

from tams_app.units import NS_PER_S


class Pace:
    """Of what comes, lets pass the first and then `rate_hz` a second."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None

    def is_due(self, t_ns: int) -> bool:
        """True if it is time, at `t_ns`; each True counts as sent."""
        due_ns = t_ns if self._due_ns is None else self._due_ns
        if t_ns < due_ns:
            return False
        self._due_ns = max(due_ns + self._period_ns, t_ns)  # what was missed is not made up for
        return True
