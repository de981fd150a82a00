"""A session on the rig in a terminal, whose episodes are kept by key until it is killed."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tams_app.recording import LOG_NAME, read_log
from tams_app.units import NS_PER_S
from tests.calibration.test_terminal import Terminal

pytestmark = [pytest.mark.waiting, pytest.mark.verify, pytest.mark.timeout(180)]


def test_a_session_killed_in_its_third_episode_leaves_two_whole(tmp_path: Path) -> None:
    words = ["run", "--sim", "--headless", "--episodes", "--out", str(tmp_path)]
    terminal = Terminal(*words, "--operator", "scripted")
    try:
        terminal.wait_for("engaged")
        for key, told in (
            ("e", "episode 1 is recorded"),
            ("e", "s: kept"),
            ("e", "episode 2 is recorded"),
            ("z", "discard episode 2? Press again"),
            ("z", "s: discarded"),
            ("e", "episode 3 is recorded"),
        ):
            time.sleep(1.0)  # a key that comes sooner may be a repeat
            terminal.type(key)
            terminal.wait_for(told)
        time.sleep(2.0)
    finally:
        terminal.process.kill()
    assert terminal.end() == -signal.SIGKILL
    (folder,) = tmp_path.iterdir()
    log = read_log(folder / LOG_NAME)
    assert log.truncated
    assert [(one.number, one.kept) for one in log.judged_episodes] == [(1, True), (2, False)]
    first, second = log.judged_episodes
    assert first.start_ns < first.end_ns < second.start_ns < second.end_ns < log.ended_ns
    for one in (first, second):
        ticks = [tick for tick in log.ticks if one.start_ns <= tick.started_ns < one.end_ns]
        assert len(ticks) > 100 * (one.end_ns - one.start_ns) / NS_PER_S
