"""How threads hand things over."""

import pytest

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
