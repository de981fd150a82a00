"""What a session has started ends in reverse, and a failure of any of it is told in a sentence."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from tams_app.errors import TamsError
from tams_app.runtime.parts import Parts

pytestmark = pytest.mark.untimed


class Process:
    """A helper process."""

    def __init__(self, pid: int | None = 7) -> None:
        self.pid, self.exit_code = pid, None

    def resend(self) -> None:
        """Nothing waits."""


@pytest.fixture
def failures() -> list[str]:
    return []


@pytest.fixture
def parts(tmp_path: Path, failures: list[str]) -> Parts:
    return Parts(tmp_path, failures.append, priority=0)


@pytest.mark.parametrize(
    ("failure", "told"),
    [(TamsError("the disk is full"), "the disk is full"), (KeyError("x"), "writer: KeyError('x')")],
)
def test_a_thread_that_fails_is_told_of_in_one_sentence(
    parts: Parts, failures: list[str], failure: Exception, told: str
) -> None:
    def body(_stop: threading.Event) -> None:
        raise failure

    assert parts.run("writer", body).join(10.0)
    assert failures == [told]


def test_what_was_started_last_is_stopped_first(parts: Parts) -> None:
    ended: list[str] = []

    def body(name: str) -> Any:
        def run(stop: threading.Event) -> None:
            stop.wait(10.0)
            ended.append(name)

        return run

    for name in ("first", "second"):
        parts.run(name, body(name))
    parts.stack.callback(ended.append, "third")
    parts.stack.close()
    assert ended == ["third", "second", "first"]


def test_a_watched_process_that_has_ended_is_a_failure(
    parts: Parts, failures: list[str], tmp_path: Path
) -> None:
    guard: Any = Process()
    parts.watch("guard", guard)
    parts.poll()
    assert failures == []
    guard.exit_code = 1
    parts.poll()
    assert failures == [f"the helper process guard ended unasked; see {tmp_path}"]


def test_a_process_that_is_not_started_has_no_pid_yet(parts: Parts) -> None:
    started, waiting = Process(11), Process(None)
    watched: Any = {"rig": started, "link": waiting}
    for name, process in watched.items():
        parts.watch(name, process)
    assert parts.pids == {"rig": 11}


def test_without_a_priority_nothing_is_hurried(parts: Parts) -> None:
    parts.hurry({"reports": -1})  # no thread has this number: it would be refused
