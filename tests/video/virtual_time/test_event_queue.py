"""The order in which things happen."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.video.virtual.event_queue import EventQueue

pytestmark = pytest.mark.untimed


@given(st.lists(st.integers(0, 5), max_size=30))
def test_actions_are_done_in_the_order_of_time_and_of_posting(times_ns: list[int]) -> None:
    events, done = EventQueue(), list[tuple[int | None, int]]()
    for place, due_ns in enumerate(times_ns):
        events.post(due_ns, lambda place=place: done.append((due, place)))
    while (due := events.next_ns) is not None:
        events.do_next()
    assert done == sorted((due_ns, place) for place, due_ns in enumerate(times_ns))
