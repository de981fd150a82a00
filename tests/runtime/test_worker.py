"""Threads with an owner."""

import threading

import pytest

from tams_app.errors import TamsError
from tams_app.runtime.worker import Worker

pytestmark = pytest.mark.waiting


def test_the_owner_learns_of_a_failure_and_of_its_name():
    told = threading.Event()
    failures = []

    def fail(stop):
        raise RuntimeError("broken")

    def on_failure(name, failure):
        failures.append((name, str(failure)))
        told.set()

    worker = Worker("camera-eih", fail, on_failure)
    worker.start()
    assert told.wait(10)
    assert failures == [("camera-eih", "broken")]
    worker.stop()
    assert isinstance(worker.failure, RuntimeError)


def test_stop_ends_a_body_that_watches_its_event_and_may_be_repeated():
    worker = Worker("idle", lambda stop: stop.wait() and None)
    worker.start()
    worker.stop()
    worker.stop()
    assert not worker.alive


def test_a_worker_that_was_never_started_can_be_stopped():
    Worker("idle", lambda stop: None).stop()


def test_a_body_that_does_not_end_is_reported_with_its_name():
    release = threading.Event()
    worker = Worker("stuck", lambda stop: release.wait(10) and None)
    worker.start()
    with pytest.raises(TamsError, match="stuck did not stop"):
        worker.stop(timeout_s=0.05)
    release.set()
    worker.stop()
