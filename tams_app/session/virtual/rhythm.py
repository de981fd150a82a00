"""What happens at a fixed rate in virtual time; beside it `clock.FixedRate`, live."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from tams_app.runtime.clock import NS_PER_S
from tams_app.video.virtual_time.event_queue import EventQueue


def repeat(
    events: EventQueue, now_ns: int, rate_hz: float, action: Callable[[int], object]
) -> None:
    """Do `action` with its due time `rate_hz` times a second, first one period after `now_ns`."""
    period_ns = round(NS_PER_S / rate_hz)

    def again(due_ns: int) -> None:
        events.post(due_ns + period_ns, partial(again, due_ns + period_ns))
        action(due_ns)

    events.post(now_ns + period_ns, partial(again, now_ns + period_ns))
