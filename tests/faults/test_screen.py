"""The keyboard moves the arm, also by taps, until the screen stands still: as the log has it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tams_app.faces.window.toolkit import Size, keep_size, size_file
from tams_app.teleop.safety import ArmingState
from tests.faces.window.xvfb import Screen, compositor, virtual_screen
from tests.faults.applications import Application, until

STOPPED_S = 2.0
LET_GO_S = 0.35  # 150 ms after the last paint, and 200 ms after the window's last beat
STAND_S = 0.1
TAPS_MS, TAKES_S = (12, 20, 50) * 3, 1.0  # a tap moves for 250 ms, the arm follows
SMALL = (640, 400)  # what draws too much paints late, and the window lets go of all keys
WORDS = ("run", "--sim", "--hand", "keyboard", "--seconds", "120")
SETTINGS: dict[str, Any] = {
    "headless": False,
    "faces": ["window"],
    "rig": {},
    "video": {"fps": 5, "width": 320, "height": 240, "quality": {"enabled": False}},
}

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]


def engage(application: Application, screen: Screen, title: str) -> None:
    """Arm the arm, and hold Shift."""
    application.says("DISARMED")
    screen.focus(title)

    def confirmed() -> bool:
        """A key just after the focus, or after a paint that came late, counts as held before."""
        screen.xdotool("key", "Return")
        return application.says_within(1.0, ("READY", "ready"))

    until(confirmed, "the arm to be ready")
    screen.xdotool("keydown", "Shift_L")
    application.says(("ENGAGED", "engaged"))
    application.note_helpers()


@pytest.mark.matrix
@pytest.mark.parametrize("stands_still", ["server", "compositor"])
def test_a_screen_that_stands_still_lets_go_of_the_keys(
    stands_still: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with virtual_screen(tmp_path, monkeypatch, *SMALL) as screen:
        keep_size(size_file(), Size(*SMALL))
        if stands_still == "compositor":
            with compositor(screen, tmp_path, monkeypatch) as pid:
                log, stopped_ns = _stop(tmp_path, screen, ".*", pid)
        else:
            log, stopped_ns = _stop(tmp_path, screen, "TAMS", screen.pid)
    after = [tick for tick in log.ticks if stopped_ns < tick.started_ns]
    during = [tick for tick in after if tick.started_ns < stopped_ns + round(STOPPED_S * 1e9)]
    engaged = [tick for tick in during if tick.arming == ArmingState.ENGAGED]
    assert engaged[-1].started_ns - stopped_ns < LET_GO_S * 1e9
    still = [t for t in after if t.started_ns > stopped_ns + (LET_GO_S + STAND_S) * 1e9]
    assert all(tick.twist.is_zero for tick in still), "also once the screen goes on"
    assert during[-1].started_ns - stopped_ns > 0.9 * STOPPED_S * 1e9
    ages_ms = [tick.inputs.video_age_ns / 1e6 for tick in during if tick.inputs is not None]
    assert np.diff(ages_ms[-30:]).min() > 0, "no frame counts that was not seen"


def _stop(tmp_path, screen, title, pid):  # type: ignore[no-untyped-def]
    settings = SETTINGS | {"controller": {"desk": {"speed_m_s": 0.02}}}
    with Application(tmp_path, words=WORDS, **settings) as application:
        engage(application, screen, title)
        screen.xdotool("keydown", "a")
        until(lambda: application.watched().moves(), "the arm to move")
        os.kill(pid, signal.SIGSTOP)
        stopped_ns = time.monotonic_ns()
        time.sleep(STOPPED_S)
        os.kill(pid, signal.SIGCONT)
        time.sleep(1.0)
        return application.interrupted(), stopped_ns


def test_each_tap_moves_the_arm_as_far_as_the_guide_says_at_five_frames_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun_ns = []
    at_once = ("--delay", "0", "d")
    with virtual_screen(tmp_path, monkeypatch, *SMALL) as screen:
        keep_size(size_file(), Size(*SMALL))
        with Application(tmp_path, words=WORDS, **SETTINGS) as application:
            engage(application, screen, "TAMS")
            for tap_ms in TAPS_MS:  # each with Shift pressed anew
                for key, state in (("keyup", "ready"), ("keydown", "engaged")):
                    before = len(application.lines)
                    screen.xdotool(key, "Shift_L")
                    application.says((state, state.upper()), before)
                begun_ns.append(time.monotonic_ns())
                pause = ("sleep", f"{tap_ms / 1000}")
                screen.xdotool("keydown", *at_once, *pause, "keyup", *at_once)
                time.sleep(TAKES_S)
            log = application.interrupted()
    ways_mm: dict[int, list[float]] = {}
    for tap_ms, ns in zip(TAPS_MS, begun_ns, strict=True):
        during = [t for t in log.ticks if 0 <= t.started_ns - ns < TAKES_S * 1e9]
        at = [tick.arm.tcp.position for tick in during if tick.arm is not None]
        if all(tick.arming == ArmingState.ENGAGED for tick in during):  # no paint came late
            ways_mm.setdefault(tap_ms, []).append(1000.0 * float(np.linalg.norm(at[-1] - at[0])))
    assert set(ways_mm) == set(TAPS_MS), ways_mm
    assert all(1.0 < way_mm < 2.0 for ways in ways_mm.values() for way_mm in ways), ways_mm
