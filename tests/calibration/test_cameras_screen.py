"""The window that flashes on a real X server's screen, read back from it."""

from __future__ import annotations

import os
import shutil
import subprocess
import time

import numpy as np
import pytest

from calibration.cameras.flashes import flashing_window
from tams_app.errors import SetupError
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.waiting

WIDTH, HEIGHT = 1024, 768
TIMEOUT_S = 60.0


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
        return pixels[::16, ::16, :3]

    yield take
    server.terminate()
    server.wait(10)


def test_the_screen_turns_white_and_black_when_it_is_due_and_not_before(photograph):
    clock = MonotonicClock()
    changes: list[tuple[int, bool]] = []
    with flashing_window(clock) as flashes:
        give_up_s = time.monotonic() + TIMEOUT_S
        lit = False
        while len(changes) < 4:
            assert time.monotonic() < give_up_s, "the screen does not flash"
            now = bool(photograph().mean() > 100)
            if now != lit:
                changes.append((clock.now_ns(), now))
                lit = now
            time.sleep(0.01)
    assert [white for _, white in changes] == [True, False, True, False]
    for (seen_ns, _), after_ns in zip(changes, flashes.after_ns, strict=False):
        assert 0 <= seen_ns - flashes.start_ns - after_ns < 5 * NS_PER_S


@pytest.mark.parametrize(("display", "words"), [("", "there is no display"), (":987", "window")])
def test_without_a_display_that_answers_it_is_one_sentence(monkeypatch, display, words):
    monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(SetupError, match=words), flashing_window(MonotonicClock()):
        pass
