"""How threads hand things over."""

import threading

from tams_app.mailbox import BoundedQueue, Mailbox


def test_a_mailbox_holds_the_newest_item_only():
    box = Mailbox()
    assert box.latest() is None
    box.put(1)
    box.put(2)
    assert box.latest() == 2
    assert box.versioned() == (2, 2)


def test_waiting_for_a_newer_item_ends_when_one_arrives():
    box = Mailbox()
    box.put("old")
    threading.Timer(0.05, box.put, ["new"]).start()
    assert box.wait_newer(1, timeout_s=10) == (2, "new")


def test_waiting_in_vain_gives_the_item_that_was_there():
    box = Mailbox()
    box.put("old")
    assert box.wait_newer(1, timeout_s=0.01) == (1, "old")


def test_a_full_queue_drops_the_new_item_and_counts_it():
    queue = BoundedQueue(2)
    assert [queue.put(item) for item in "abc"] == [True, True, False]
    assert queue.dropped == 1
    assert queue.take_all() == ["a", "b"]
    assert queue.take_all(timeout_s=0.01) == []
