"""A screen that stands still while the keyboard moves the arm, as the arm's log has it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tams_app.faces.window.size_memory import Size, keep_size, size_file
from tams_app.teleop.safety import ArmingState
from tests.faces.window.xvfb import Screen, compositor, virtual_screen
from tests.faults.applications import Application, until

STOPPED_S = 2.0
LET_GO_S = 0.35  # 150 ms after the last paint, and 200 ms after the window's last beat
STAND_S = 0.1
SMALL = (640, 400)  # what draws too much paints late, and the window lets go of all keys

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]


def engage(application: Application, screen: Screen, title: str) -> None:
    """Arm the arm, and hold the keys until it moves."""
    application.says("DISARMED")
    screen.focus(title)

    def confirmed() -> bool:
        """A key just after the focus, or after a paint that came late, counts as held before."""
        screen.xdotool("key", "Return")
        return application.says_within(1.0, ("READY", "ready"))

    until(confirmed, "the arm to be ready")
    screen.xdotool("keydown", "Shift_L", "keydown", "a")
    application.says(("ENGAGED", "engaged"))
    application.note_helpers()
    until(lambda: application.watched().moves(), "the arm to move")


@pytest.mark.parametrize("stands_still", ["server", "compositor"])
def test_a_screen_that_stands_still_lets_go_of_the_keys(
    stands_still: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("run", "--sim", "--hand", "keyboard", "--seconds", "120")
    settings = {
        "headless": False,
        "faces": ["window"],
        "controller": {"desk": {"speed_m_s": 0.02}},
        "rig": {},
        "video": {"fps": 5, "width": 320, "height": 240, "quality": {"enabled": False}},
    }
    with virtual_screen(tmp_path, monkeypatch, *SMALL) as screen:
        keep_size(size_file(), Size(*SMALL))
        if stands_still == "compositor":
            with compositor(screen, tmp_path, monkeypatch) as pid:
                log, stopped_ns = _stop(tmp_path, words, settings, screen, ".*", pid)
        else:
            log, stopped_ns = _stop(tmp_path, words, settings, screen, "TAMS", screen.pid)
    after = [tick for tick in log.ticks if stopped_ns < tick.started_ns]
    during = [tick for tick in after if tick.started_ns < stopped_ns + round(STOPPED_S * 1e9)]
    engaged = [tick for tick in during if tick.arming == ArmingState.ENGAGED]
    assert engaged[-1].started_ns - stopped_ns < LET_GO_S * 1e9
    still = [t for t in after if t.started_ns > stopped_ns + (LET_GO_S + STAND_S) * 1e9]
    assert all(tick.twist.is_zero for tick in still), "also once the screen goes on"
    assert during[-1].started_ns - stopped_ns > 0.9 * STOPPED_S * 1e9
    ages_ms = [tick.inputs.video_age_ns / 1e6 for tick in during if tick.inputs is not None]
    assert np.diff(ages_ms[-30:]).min() > 0, "no frame counts that was not seen"


def _stop(tmp_path, words, settings, screen, title, pid):  # type: ignore[no-untyped-def]
    with Application(tmp_path, words=words, **settings) as application:
        engage(application, screen, title)
        os.kill(pid, signal.SIGSTOP)
        stopped_ns = time.monotonic_ns()
        time.sleep(STOPPED_S)
        os.kill(pid, signal.SIGCONT)
        time.sleep(1.0)
        return application.interrupted(), stopped_ns
