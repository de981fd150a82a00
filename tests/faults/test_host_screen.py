"""A screen that takes no text any more, such as a stalled remote shell, while the arm moves."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tams_app.faces.terminal.line import PLAIN_EVERY_S
from tams_app.units import NS_PER_S
from tests.faults.applications import Application, Screen, only_log, until

SECONDS = 25.0
RESTS_S = 1.5  # of a busy machine; the control loop itself ends at the next tick

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]


@pytest.fixture(params=[True, False], ids=["terminal", "pipe"])
def screen(request: pytest.FixtureRequest) -> Iterator[Screen]:
    made = Screen(request.param)
    yield made
    made.close()


def test_sigterm_ends_a_session_whose_screen_takes_no_text(tmp_path: Path, screen: Screen) -> None:
    with Application(tmp_path, screen=screen) as application:
        witness = application.engaged()
        screen.stuck()
        time.sleep(PLAIN_EVERY_S + 1.0)  # it has had something to print
        until(witness.moves, "the arm to move")
        application.process.send_signal(signal.SIGTERM)
        until(lambda: not witness.moves(), "the arm to come to rest", RESTS_S)
        assert application.process.wait(30.0) == 130
        assert not only_log(application.out).truncated


def test_the_time_limit_ends_a_session_whose_screen_takes_no_text(
    tmp_path: Path, screen: Screen
) -> None:
    with Application(tmp_path, screen=screen, seconds=SECONDS) as application:
        application.engaged()
        screen.stuck()
        application.process.wait(60.0)
        log = only_log(application.out)
        assert not log.truncated
        assert log.ticks[-1].started_ns - log.header.started_ns < (SECONDS + 2.0) * NS_PER_S
