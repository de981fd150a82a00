"""The order in which things happen."""

from __future__ import annotations

import pytest

from tams_app.video.virtual.event_queue import EventQueue

pytestmark = pytest.mark.untimed


def drain(events: EventQueue) -> None:
    while events.next_ns is not None:
        events.do_next()


def test_actions_are_done_in_the_order_of_time() -> None:
    events, done = EventQueue(), list[int]()
    for due_ns in (30, 10, 20):
        events.post(due_ns, lambda due_ns=due_ns: done.append(due_ns))
    assert events.next_ns == 10
    drain(events)
    assert done == [10, 20, 30]


def test_actions_of_the_same_time_are_done_in_the_order_of_posting() -> None:
    events, done = EventQueue(), list[int]()
    for number in range(20):
        events.post(5, lambda number=number: done.append(number))
    drain(events)
    assert done == list(range(20))
