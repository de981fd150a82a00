"""`replay --mark` with its real window: keys mark what is shown."""

from __future__ import annotations

import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from tams_app.console.replay.marks import Mark, read_marks
from tams_app.console.replay.run import run_replay
from tams_app.errors import SetupError, UnreadableLogError
from tams_app.recording import LOG_NAME
from tams_app.records import Phase
from tests.calibration.phase_trials import record
from tests.console.replay.test_replay_window import line_in_bar
from tests.faces.played_session import window_processes
from tests.faces.window.photographs import is_colour
from tests.faces.window.xvfb import Screen, wait_for
from tests.golden_logs import golden_log

# a window takes keys only while it was painted within 150 ms
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

LAST_S = 14.0
ROW, BAR = 659, slice(186, 1274)  # of the marks, in a window of 1280x720
MARKED_NOW = "#E4E8EB"
BEFORE = [Mark(2.0, Phase.REACH), Mark(3.0, Phase.ALIGN)]


def test_keys_mark_in_the_window_what_the_fit_reads(screen: Screen, tmp_path: Path) -> None:
    shutil.copy(golden_log("outage"), tmp_path / LOG_NAME)
    first = tmp_path / "phases.csv"
    first.write_text("t_s,phase\n2.0,REACH\n3.0,ALIGN\n")

    def in_a_new_window(*keys: str) -> None:
        assert wait_for(lambda: bool(window_processes()))
        screen.focus("TAMS replay")
        assert wait_for(lambda: line_in_bar(screen) is not None)
        time.sleep(1.0)  # a key just after the focus may have been down before it
        screen.xdotool(*(word for key in keys for word in ("key", key)))

    def are_marks(path: Path, marks: list[Mark]) -> bool:
        return wait_for(lambda: path.is_file() and read_marks(path, LAST_S) == marks)

    def shows(since_s: float) -> bool:
        return marked_since(screen) == pytest.approx(since_s, abs=0.06)

    def act() -> None:
        in_a_new_window("Right", "3", "Page_Down", "Page_Down", "4")
        grasp, transport = Mark(8.0, Phase.GRASP), Mark(8.2, Phase.TRANSPORT)
        assert are_marks(first, [*BEFORE, grasp, transport])
        assert wait_for(lambda: shows(8.2))

        screen.xdotool("key", "BackSpace")
        assert are_marks(first, [*BEFORE, grasp])
        assert wait_for(lambda: shows(8.0))
        screen.xdotool("key", "q")

    with ThreadPoolExecutor(1) as pool:
        acted = pool.submit(act)
        run_replay(tmp_path, mark=True)
        acted.result()
    assert window_processes() == []


def marked_since(screen: Screen) -> float | None:
    """When the phase began that is marked at the moment shown [s], as the bar shows it."""
    row = screen.photograph()[ROW : ROW + 1, BAR]
    columns = np.flatnonzero(is_colour(row, MARKED_NOW)[0])
    return LAST_S * float(columns[0]) / row.shape[1] if len(columns) else None


def test_marking_needs_a_display_and_a_log_with_an_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(tmp_path / "empty", [], [])
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SetupError, match="start it where there is a display, or write"):
        run_replay(tmp_path / "empty", mark=True)
    monkeypatch.setenv("DISPLAY", ":none")
    with pytest.raises(UnreadableLogError, match="has no state of the arm"):
        run_replay(tmp_path / "empty", mark=True)
