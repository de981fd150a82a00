"""How threads hand things over."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.runtime.mailbox import BoundedQueue, Mailbox

pytestmark = pytest.mark.waiting


def test_a_mailbox_holds_the_newest_item_only():
    box = Mailbox()
    assert box.latest() is None
    box.put(1)
    box.put(2)
    assert box.latest() == 2
    assert box.latest() == 2


def test_a_full_queue_drops_the_new_item_and_counts_it():
    queue = BoundedQueue(2)
    assert [queue.put(item) for item in "abc"] == [True, True, False]
    assert queue.dropped == 1
    assert queue.take_all() == ["a", "b"]
    assert queue.take_all(timeout_s=0.01) == []


@given(st.integers(1, 8), st.lists(st.lists(st.integers(), max_size=6), max_size=6))
def test_a_batch_is_queued_as_its_items_one_by_one(capacity, batches):
    at_once, one_by_one = BoundedQueue(capacity), BoundedQueue(capacity)
    for batch in batches:
        at_once.put_all(batch)
        for item in batch:
            one_by_one.put(item)
    assert at_once.dropped == one_by_one.dropped
    assert at_once.take_all() == one_by_one.take_all()
