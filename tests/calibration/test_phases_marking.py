"""`calibrate phases --mark` with its real window: keys mark what is shown, log after log."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from calibration.options import PhaseOptions
from calibration.phases.wizard import PhaseWizard
from tams_app.console.replay.marks import Mark, read_marks
from tams_app.recording import LOG_NAME
from tams_app.records import Phase
from tests.console.replay.test_replay_window import line_in_bar
from tests.faces.played_session import window_processes
from tests.faces.window.photographs import is_colour
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for
from tests.golden_logs import golden_log
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.waiting

LAST_S = 14.0
ROW, BAR = 659, slice(186, 1274)  # of the marks, in a window of 1280x720
MARKED_NOW = "#E4E8EB"
BEFORE = [Mark(2.0, Phase.REACH), Mark(3.0, Phase.ALIGN)]


@pytest.fixture
def screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Screen]:
    with virtual_screen(tmp_path, monkeypatch) as found:
        yield found


def test_keys_mark_in_the_window_what_the_fit_reads_and_q_goes_on_to_the_next_log(
    screen: Screen, tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("first", "second")]
    for folder in folders:
        folder.mkdir()
        shutil.copy(golden_log("outage"), folder / LOG_NAME)
    first, second = (folder / "phases.csv" for folder in folders)
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
        assert wait_for(lambda: not window_processes())
        in_a_new_window("Page_Down", "1", "q")

    options = PhaseOptions(config=None, logs=folders, mark=True)
    with ThreadPoolExecutor(1) as pool:
        acted = pool.submit(act)
        assert PhaseWizard(ScriptedUI(), options).run() == 0
        acted.result()
    assert read_marks(second, LAST_S) == [Mark(0.1, Phase.REACH)]
    assert window_processes() == []


def marked_since(screen: Screen) -> float | None:
    """When the phase began that is marked at the moment shown [s], as the bar shows it."""
    row = screen.photograph()[ROW : ROW + 1, BAR]
    columns = np.flatnonzero(is_colour(row, MARKED_NOW)[0])
    return LAST_S * float(columns[0]) / row.shape[1] if len(columns) else None
