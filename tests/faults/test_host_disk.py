"""A disk that stands still under the log: a file system that is frozen, so who writes waits."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.recording import LOG_NAME, read_log
from tams_app.recording.journal import CAPACITY, LOST
from tams_app.records import Note
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.session import Outset, Session
from tams_app.summary import summarise
from tams_app.units import NS_PER_S
from tests.faults.applications import Application, until

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.timeout(300),
]

HANGS = "the disk of the log does not respond"


def run(*words: str | Path) -> None:
    subprocess.run(words, check=True, capture_output=True)


@pytest.fixture
def disk() -> Iterator[Path]:
    """Where it is mounted: not in pytest's folder, which could not be deleted after a kill."""
    with tempfile.TemporaryDirectory(prefix="tams-disk-") as place, ExitStack() as stack:
        image, folder = Path(place) / "image", Path(place) / "disk"
        folder.mkdir()
        try:
            run("truncate", "-s", "128M", image)
            run("mkfs.ext4", "-q", "-F", image)
            run("mount", "-o", "loop", image, folder)
            stack.callback(run, "umount", folder)
            run("fsfreeze", "-f", folder)
            run("fsfreeze", "-u", folder)
        except (OSError, subprocess.CalledProcessError) as error:
            pytest.skip(f"no file system can be mounted and frozen here: {error}")
        thaw = "fsfreeze", "-u", folder
        stack.callback(lambda: subprocess.run(thaw, check=False, capture_output=True))
        yield folder


def test_what_a_disk_that_stands_still_costs_is_warned_of_counted_and_fails_episodes(
    disk: Path,
) -> None:
    recording = {"recording.episodes": True, "recording.min_free_mb": 1}
    config = load_config(None, {**recording, "control.realtime_priority": 0})
    clock, path = MonotonicClock(), disk / LOG_NAME
    outset = Outset(config, clock, disk, Signals())
    does_nothing: Any = lambda *_: ""  # noqa: E731
    side: Any = SimpleNamespace(poll=does_nothing, stop_arm=does_nothing, finish=does_nothing)
    stack = ExitStack()
    parts = stack.enter_context(outset.starting())
    journal = outset.open_log(config, parts)
    session = stack.enter_context(Session(outset, parts, journal, side))

    def warns(beginning: str) -> bool:
        session.poll()
        return any(one.startswith(beginning) for one in session.sentences.take())

    run("fsfreeze", "-f", disk)
    journal.record(Note(clock.now_ns(), "info", "0"))
    until(lambda: warns(HANGS), HANGS)
    for number in range(1, CAPACITY + 100):
        journal.record(Note(clock.now_ns(), "info", str(number)))
    until(lambda: warns(LOST), LOST)
    run("fsfreeze", "-u", disk)
    until(lambda: bool(read_log(path, only=()).lost), "the log to say what it lacks")
    stack.close()
    log = read_log(path)
    (lost,) = log.lost
    assert outset.failure == f"{lost.records} records are missing from the log; record it again"
    assert lost.records >= CAPACITY + 100 - sum(note.text.isdigit() for note in log.notes) > 0
    summary = summarise(log)
    assert (summary["complete"], summary["records_lost"]) == (False, lost.records)
    (missing,) = summary["missing"]
    assert missing["start_s"] < missing["end_s"]


@pytest.mark.usefixtures("real_time")
def test_a_session_whose_disk_stands_still_warns_at_once_and_goes_on(disk: Path) -> None:
    with Application(disk) as application:
        witness = application.engaged()
        before = len(application.lines)
        run("fsfreeze", "-f", disk)
        application.says(HANGS, before)
        until(witness.moves, "the arm to move")
        run("fsfreeze", "-u", disk)
        log = application.interrupted()
    assert log.complete
    assert np.max(np.diff([tick.due_ns for tick in log.ticks])) < NS_PER_S  # in the log, too
