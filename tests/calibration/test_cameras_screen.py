"""The time pattern on a real X server's screen, read back from it."""

from __future__ import annotations

import os
import shutil
import subprocess
import time

import numpy as np
import pytest

from calibration.cameras.screen import shown_pattern
from calibration.cameras.time_pattern import PatternReader
from tams_app.errors import SetupError
from tams_app.runtime.clock import NS_PER_S, MonotonicClock

pytestmark = pytest.mark.waiting

WIDTH, HEIGHT = 1024, 768
PATIENCE_S = 60.0


@pytest.fixture
def photograph(tmp_path, monkeypatch):
    """An X server whose screen is a file; gives a function that takes an image of it."""
    if shutil.which("Xvfb") is None:
        pytest.skip("needs Xvfb (apt-get install xvfb)")
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24"]
    server = subprocess.Popen(
        [*command, "-fbdir", str(tmp_path)], pass_fds=(writing,), stderr=subprocess.DEVNULL
    )
    os.close(writing)
    with os.fdopen(reading) as number:
        monkeypatch.setenv("DISPLAY", f":{number.readline().strip()}")

    def take():
        dump = (tmp_path / "Xvfb_screen0").read_bytes()  # XWD: header, colour map, BGRX rows
        pixels = np.frombuffer(dump[-WIDTH * HEIGHT * 4 :], np.uint8).reshape(HEIGHT, WIDTH, 4)
        return np.ascontiguousarray(pixels[:, :, :3])

    yield take
    server.terminate()
    server.wait(10)


def test_what_is_on_the_screen_was_due_there_and_not_before(photograph):
    clock, reader = MonotonicClock(), PatternReader()
    counts: list[int] = []
    with shown_pattern(clock, 30, 24) as screen:
        give_up_s = time.monotonic() + PATIENCE_S
        while len(counts) < 5:
            assert time.monotonic() < give_up_s, "the screen shows no pattern"
            reading = reader.read(photograph())
            taken_ns = clock.now_ns()
            if reading.count >= 0 and reading.count not in counts:
                counts.append(reading.count)
                due_ns = screen.start_ns + reading.count * screen.period_ns
                assert due_ns <= taken_ns
                assert taken_ns - due_ns < 5 * NS_PER_S
            time.sleep(0.02)
    assert counts == sorted(counts)


def test_without_a_display_it_is_one_sentence(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with (
        pytest.raises(SetupError, match="there is no display"),
        shown_pattern(MonotonicClock(), 60, 24),
    ):
        pass


def test_a_display_that_does_not_answer_is_one_sentence(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":987")
    with (
        pytest.raises(SetupError, match="pattern"),
        shown_pattern(MonotonicClock(), 60, 24),
    ):
        pass
