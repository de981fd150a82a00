"""GStreamer's test clock in our hands, and the order of what is done beside it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app import gst
from tams_app.video.virtual.stepped_clock import EventQueue, SteppedClock
from tams_app.video.virtual.wait_idle import IdleWaiter

pytestmark = pytest.mark.untimed


def test_time_begins_after_zero_moves_only_when_told_and_never_back() -> None:
    clock = SteppedClock(1000)
    assert clock.now_ns() == 1000
    clock.move_to(5000)
    assert clock.now_ns() == 5000
    with pytest.raises(ValueError, match="does not go back"):
        clock.move_to(4999)
    with pytest.raises(ValueError, match="after 0"):
        SteppedClock(0)


def test_a_wait_ends_when_it_is_told_to_and_not_when_time_passes() -> None:
    Gst = gst.load().Gst
    clock, waiter = SteppedClock(1000), IdleWaiter()
    pipeline = gst.parse_pipeline(
        "appsrc name=in format=time ! appsink name=out sync=true async=false"
    )
    clock.drive(pipeline)
    gst.set_playing(pipeline, "the test")
    pipeline.get_by_name("in").emit("push-buffer", gst.raw_buffer(b"x", 500, 1))
    sink = pipeline.get_by_name("out")
    waiter.wait()
    assert clock.next_ns() == 1500
    clock.move_to(2000)
    waiter.wait()
    assert sink.get_property("eos") is False
    assert sink.emit("try-pull-sample", 0) is None
    clock.end_next_wait()
    waiter.wait()
    assert sink.emit("try-pull-sample", 0).get_buffer().pts == 500
    assert clock.next_ns() is None
    gst.shut_down(pipeline)
    waiter.close()
    assert pipeline.get_state(0)[1] == Gst.State.NULL


@given(st.lists(st.integers(0, 5), max_size=30))
def test_actions_are_done_in_the_order_of_time_and_of_posting(times_ns: list[int]) -> None:
    events, done = EventQueue(), list[tuple[int | None, int]]()
    for place, due_ns in enumerate(times_ns):
        events.post(due_ns, lambda place=place: done.append((due, place)))
    while (due := events.next_ns) is not None:
        events.do_next()
    assert done == sorted((due_ns, place) for place, due_ns in enumerate(times_ns))
