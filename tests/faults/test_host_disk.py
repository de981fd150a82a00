"""A disk that stands still under the log while the arm moves: a real one.

The log lies in a file system of its own, which is frozen: who writes to it waits until it thaws.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.recording import LOG_NAME, read_log
from tams_app.recording.writer import CAPACITY, LOST
from tams_app.records import Note
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.session import Session
from tams_app.summary.summarise import save_summary
from tams_app.units import NS_PER_S
from tests.faults.applications import Application, until

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.timeout(300),
]

HANGS = "the disk of the log does not respond"
_BYTES = 128_000_000


class Disk:
    """A file system in a file, for `folder`.

    Not in pytest's own folder: were this process killed, the next run could not delete that.
    """

    def __init__(self) -> None:
        self._place = Path(tempfile.mkdtemp(prefix="tams-disk-"))
        self._image, self.folder = self._place / "disk.img", self._place / "disk"
        self.folder.mkdir()
        with self._image.open("wb") as image:
            image.truncate(_BYTES)

    def mount(self) -> None:
        """CalledProcessError or OSError where that, or freezing it, cannot be."""
        _run("mkfs.ext4", "-q", "-F", self._image)
        _run("mount", "-o", "loop", self._image, self.folder)
        self.freeze()
        self.thaw()

    def freeze(self) -> None:
        """From now on who writes waits."""
        _run("fsfreeze", "-f", self.folder)

    def thaw(self) -> None:
        _run("fsfreeze", "-u", self.folder)

    def close(self) -> None:
        subprocess.run(["fsfreeze", "-u", self.folder], check=False, capture_output=True)
        subprocess.run(["umount", self.folder], check=False, capture_output=True)
        shutil.rmtree(self._place)


def _run(*words: str | Path) -> None:
    subprocess.run(words, check=True, capture_output=True)


@pytest.fixture
def disk() -> Iterator[Disk]:
    made = Disk()
    try:
        try:
            made.mount()
        except (OSError, subprocess.CalledProcessError) as error:
            pytest.skip(f"no file system can be mounted and frozen here: {error}")
        yield made
    finally:
        made.close()


class Elsewhere:
    """The side of a session that does nothing beside its log."""

    station, pids = None, {}

    def __init__(self, session: Session) -> None:
        session.open_log(session.config, is_real=False)

    def poll(self) -> str:
        return ""

    def stop_arm(self, failed: bool) -> None: ...

    def finish(self, reason: str, failed: bool) -> None: ...


def test_what_a_disk_that_stands_still_costs_is_warned_of_counted_and_fails_episodes(
    disk: Disk,
) -> None:
    settings = {"recording.episodes": True, "recording.min_free_mb": 1.0}
    config = load_config(None, {**settings, "control.realtime_priority": 0})
    clock, path = MonotonicClock(), disk.folder / LOG_NAME
    compose: Any = Elsewhere
    session = Session(config, clock, disk.folder, Signals(), compose)
    session.start()
    warned: list[str] = []

    def warns(beginning: str) -> bool:
        session.poll()
        warned.extend(session.sentences.take())
        return any(one.startswith(beginning) for one in warned)

    def record(number: int) -> None:
        session.log.record(Note(clock.now_ns(), "info", str(number)))

    disk.freeze()
    record(0)
    until(lambda: warns(HANGS), HANGS)
    for number in range(1, CAPACITY + 100):
        record(number)
    until(lambda: warns(LOST), LOST)
    disk.thaw()
    until(lambda: bool(read_log(path, only=()).lost), "the log to say what it lacks")
    session.close()
    log = read_log(path)
    (lost,) = log.lost
    assert session.failure == f"{lost.records} records are missing from the log; record it again"
    assert lost.since_ns < lost.t_ns
    assert lost.records >= CAPACITY + 100 - sum(note.text.isdigit() for note in log.notes) > 0
    summary = save_summary(log, disk.folder)
    assert (summary["complete"], summary["records_lost"]) == (False, lost.records)
    assert len(summary["missing"]) == 1
    assert not log.truncated


@pytest.mark.usefixtures("real_time")
def test_a_session_whose_disk_stands_still_warns_at_once_and_goes_on(disk: Disk) -> None:
    with Application(disk.folder) as application:
        witness = application.engaged()
        before = len(application.lines)
        disk.freeze()
        application.says(HANGS, before)
        until(witness.moves, "the arm to move")
        disk.thaw()
        log = application.interrupted()
    assert log.complete
    assert np.max(np.diff([tick.due_ns for tick in log.ticks])) < NS_PER_S  # in the log, too
