"""The window that flashes on a real X server's screen, read back from it."""

from __future__ import annotations

import time

import pytest

from calibration.cameras.flashes import flashing_window
from tams_app.errors import SetupError
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.waiting

TIMEOUT_S = 60.0


def test_the_screen_turns_white_and_black_when_it_is_due_and_not_before(screen):
    clock = MonotonicClock()
    changes: list[tuple[int, bool]] = []
    with flashing_window(clock) as flashes:
        give_up_s = time.monotonic() + TIMEOUT_S
        lit = False
        while len(changes) < 4:
            assert time.monotonic() < give_up_s, "the screen does not flash"
            now = bool(screen.photograph()[::16, ::16].mean() > 100)
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
