"""A session on the rig in a terminal, whose episodes are kept by key until it is killed."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tams_app.recording import LOG_NAME, read_log
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.units import NS_PER_S

pytestmark = [pytest.mark.waiting, pytest.mark.verify, pytest.mark.timeout(180)]


class Terminal:
    """What the session writes, and keys for it."""

    def __init__(self, operator: int) -> None:
        self._operator = operator
        self._seen = b""
        os.set_blocking(operator, False)

    def wait_for(self, words: str, limit_s: float = 60.0) -> None:
        """Until it has written them since the last time."""
        deadline_s = time.monotonic() + limit_s
        while words.encode() not in self._seen:
            assert time.monotonic() < deadline_s, (words, self._seen[-2000:])
            try:
                self._seen += os.read(self._operator, 65536)
            except BlockingIOError:
                time.sleep(0.05)
        self._seen = self._seen.partition(words.encode())[2]

    def press(self, key: str) -> None:
        time.sleep(1.0)  # a key that comes sooner may be a repeat
        os.write(self._operator, key.encode())


def test_a_session_killed_in_its_third_episode_leaves_two_whole(tmp_path: Path) -> None:
    operator, program = pty.openpty()
    words = ["run_tams.py", "run", "--sim", "--headless", "--episodes", "--out", str(tmp_path)]
    with subprocess.Popen(
        [sys.executable, *words, "--operator", "scripted"],
        cwd=PROJECT_DIRECTORY,
        stdin=program,
        stdout=program,
        stderr=program,
    ) as session:
        terminal = Terminal(operator)
        terminal.wait_for("engaged")
        for key, words in (
            ("e", "episode 1 is recorded"),
            ("e", "s: kept"),
            ("e", "episode 2 is recorded"),
            ("z", "discard episode 2? Press again"),
            ("z", "s: discarded"),
            ("e", "episode 3 is recorded"),
        ):
            terminal.press(key)
            terminal.wait_for(words)
        time.sleep(2.0)
        session.send_signal(signal.SIGKILL)
        session.wait(timeout=20)
    for end in (operator, program):
        os.close(end)
    (folder,) = tmp_path.iterdir()
    log = read_log(folder / LOG_NAME)
    assert log.truncated
    assert [(one.number, one.kept) for one in log.judged_episodes] == [(1, True), (2, False)]
    first, second = log.judged_episodes
    assert first.start_ns < first.end_ns < second.start_ns < second.end_ns < log.ended_ns
    for one in (first, second):
        ticks = [tick for tick in log.ticks if one.start_ns <= tick.started_ns < one.end_ns]
        assert len(ticks) > 100 * (one.end_ns - one.start_ns) / NS_PER_S
