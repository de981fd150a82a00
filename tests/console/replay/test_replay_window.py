"""A replay in its real window: keys and the bar go to any moment of the log, and that is seen."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from tams_app.cli import _main
from tams_app.console.replay import run
from tams_app.console.replay.session import ReplaySession
from tams_app.faces.canvas import INK
from tams_app.recording import LOG_NAME
from tests.faces.played_session import window_processes
from tests.faces.window.photographs import banner_is, is_colour
from tests.faces.window.xvfb import Screen, wait_for
from tests.golden_logs import golden_log

# a window takes keys only while it was painted within 150 ms
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

LENGTH_S = 14.0  # of the log
BAR_LEFT, BAR_RIGHT, BAR_ROW = 186, 1274, 692  # of a window of 1280x720; the row is that of states


class Watched:
    """The replay that the command makes, and what is seen of it."""

    def __init__(self, screen: Screen) -> None:
        self.screen = screen
        self.session: ReplaySession | None = None

    def make(self, *arguments: object) -> ReplaySession:
        self.session = ReplaySession(*arguments)  # type: ignore[arg-type]
        return self.session

    def is_at(self, t_s: float, arming: str) -> bool:
        """Whether it stands there, and the window shows that."""
        assert self.session is not None
        line_s = line_in_bar(self.screen)
        return (
            abs(self.session.elapsed_s() - t_s) < 0.1
            and line_s is not None
            and abs(line_s - t_s) < 0.1
            and banner_is(self.screen.photograph(), arming)
        )

    def point(self, t_s: float, *actions: str) -> None:
        """Move the mouse to that moment in the bar, and click or drag there."""
        x = BAR_LEFT + t_s / LENGTH_S * (BAR_RIGHT - BAR_LEFT)
        self.screen.xdotool("mousemove", str(round(x)), str(BAR_ROW - 20), *actions)


def line_in_bar(screen: Screen) -> float | None:
    """The moment of the log [s] at which the line of the position stands."""
    row = screen.photograph()[BAR_ROW : BAR_ROW + 1, BAR_LEFT:BAR_RIGHT]
    columns = np.flatnonzero(is_colour(row, INK)[0])
    return float(columns.mean()) / (BAR_RIGHT - BAR_LEFT) * LENGTH_S if len(columns) else None


@pytest.fixture
def replayed(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Callable[[Watched], None]], int]:
    """Runs the command on a log while a thread of its own does something; the exit code."""
    folder = tmp_path / "session"
    folder.mkdir()
    shutil.copy(golden_log("outage"), folder / LOG_NAME)
    watched = Watched(screen)
    monkeypatch.setattr(run, "ReplaySession", watched.make)

    def replay(do: Callable[[Watched], None]) -> int:
        def act() -> None:
            try:
                screen.focus("TAMS replay")
                do(watched)
            finally:
                if watched.session is not None:
                    watched.session.end("done")

        with ThreadPoolExecutor(1) as pool:
            acted = pool.submit(act)
            code = _main(["replay", str(folder), "--speed", "0.05"])
        acted.result()
        assert window_processes() == []
        return code

    return replay


def test_keys_and_the_bar_go_to_any_moment_and_the_window_shows_it(
    replayed: Callable[[Callable[[Watched], None]], int],
) -> None:
    def seek(watched: Watched) -> None:
        screen = watched.screen
        assert wait_for(lambda: line_in_bar(screen) is not None)
        time.sleep(1.0)  # a key just after the focus may have been down before it
        screen.xdotool("key", "End")
        assert wait_for(lambda: watched.is_at(LENGTH_S, "holding"))
        watched.point(1.0, "click", "1")  # it goes on from there
        assert wait_for(lambda: watched.session.elapsed_s() < 10.0)
        screen.xdotool("mousemove", "1210", "43", "click", "1")  # the button pauses it
        assert wait_for(lambda: watched.session.playback.paused)
        for t_s, arming in ((5.0, "engaged"), (13.5, "holding"), (0.5, "disarmed")):
            watched.point(t_s, "click", "1")
            assert wait_for(lambda there=(t_s, arming): watched.is_at(*there)), (t_s, arming)
        watched.point(3.0, "mousedown", "1")
        watched.point(9.0)
        assert wait_for(lambda: watched.is_at(9.0, "engaged"))
        watched.point(13.5, "mouseup", "1")
        assert wait_for(lambda: watched.is_at(13.5, "holding"))
        screen.xdotool("key", "Home")
        assert wait_for(lambda: watched.is_at(0.0, "starting"))
        screen.xdotool("mousemove", "1210", "43", "click", "1")  # and lets it go on
        assert wait_for(lambda: watched.session.elapsed_s() > 0.1)

    assert replayed(seek) == 0
