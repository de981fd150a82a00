"""What the operator cannot see is not seen: no key is held, and no frame counts."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tams_app.errors import SetupError
from tams_app.faces.client import WINDOW, FaceClient
from tams_app.faces.commands import Command
from tams_app.faces.messages import Keys
from tams_app.faces.terminal.keys import REPEAT_NS
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tests.faces.window.conftest import ShownWindow, shown_window
from tests.faces.window.facts import OPENING
from tests.faces.window.logind import logind
from tests.faces.window.xvfb import Screen, compositor, virtual_screen, wait_for

# a window that does not paint for 150 ms lets go of all keys
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

BLACK = {view: np.zeros((OPENING.height, OPENING.width, 3), np.uint8) for view in OPENING.views}


def keys_of(window: ShownWindow) -> Keys:
    assert window.client.keys is not None
    return window.client.keys


def hold(window: ShownWindow) -> None:
    """Hold the keys that move the arm."""
    window.screen.xdotool("keydown", "Shift_L", "keydown", "a")
    assert wait_for(lambda: set(keys_of(window).held) == {"Shift_L", "a"}), keys_of(window)


def sees(window: ShownWindow) -> None:
    """A frame that comes now."""
    put_ns = window.put(BLACK)
    assert wait_for(
        lambda: keys_of(window).focused and keys_of(window).seen_ns == dict.fromkeys(BLACK, put_ns)
    )


def lets_go_unseen(window: ShownWindow) -> None:
    """It reports on, and by then that nothing is held; a frame that comes now is not seen."""
    assert wait_for(lambda: not keys_of(window).focused)
    assert keys_of(window).held == ()
    put_ns, reported = window.put(BLACK), len(window.events)
    assert wait_for(lambda: len(window.events) > reported + 20)
    assert keys_of(window).held == ()
    assert all(seen_ns < put_ns for seen_ns in keys_of(window).seen_ns.values())


def is_seen_again(window: ShownWindow) -> None:
    """The newest frame counts, and only what is pressed from now on is held."""
    sees(window)
    assert keys_of(window).held == ()
    window.screen.xdotool("keyup", "a", "keyup", "Shift_L")
    time.sleep(REPEAT_NS / NS_PER_S)  # a key sooner may have been down before
    hold(window)


@pytest.mark.matrix
def test_what_a_compositor_shows_that_stands_still_is_not_seen(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        compositor(screen, tmp_path, monkeypatch) as pid,
        shown_window(tmp_path, screen, ".*") as window,
    ):
        hold(window)
        os.kill(pid, signal.SIGSTOP)
        lets_go_unseen(window)
        screen.xdotool("keyup", "a", "keyup", "Shift_L", "key", "Return")
        os.kill(pid, signal.SIGCONT)
        is_seen_again(window)
        assert window.commands() == [], (
            "what was pressed before the screen was new confirms nothing"
        )


def test_a_window_without_new_video_is_seen_all_the_same(screen: Screen, tmp_path: Path) -> None:
    with shown_window(tmp_path, screen) as window:
        before = len(window.events)
        assert wait_for(lambda: len(window.events) > before + 50)
        found = [keys.focused for keys in window.events[before:] if isinstance(keys, Keys)]
        assert sum(found) > len(found) / 2
        assert keys_of(window).drawings == 0


@pytest.mark.matrix
def test_what_an_x_server_shows_that_stands_still_is_not_seen(
    screen: Screen, tmp_path: Path
) -> None:
    with shown_window(tmp_path, screen) as window:
        hold(window)
        os.kill(screen.pid, signal.SIGSTOP)
        time.sleep(0.5)
        put_ns = window.put(BLACK)
        time.sleep(0.5)
        last = keys_of(window)
        assert time.monotonic_ns() - last.t_ns > NS_PER_S // 2, "it reports nothing"
        before = len(window.events)
        os.kill(screen.pid, signal.SIGCONT)
        assert wait_for(lambda: len(window.events) > before)
        first = next(event for event in window.events[before:] if isinstance(event, Keys))
        assert first.held == ()
        assert put_ns not in first.seen_ns.values(), "the server took nothing meanwhile"
        is_seen_again(window)


def test_what_was_pressed_while_the_window_stood_still_only_stops_the_arm(
    screen: Screen, tmp_path: Path
) -> None:
    """A confirmation that is old by then would clear the fault of the standstill itself."""
    with shown_window(tmp_path, screen) as window:
        assert window.client.pid is not None
        for key, asked in (("Return", []), ("space", [Command.EMERGENCY_STOP])):
            os.kill(window.client.pid, signal.SIGSTOP)
            screen.xdotool("key", key)
            time.sleep(3.0)
            os.kill(window.client.pid, signal.SIGCONT)
            sees(window)
            assert window.commands() == asked
            assert "Return" not in keys_of(window).presses


@pytest.mark.matrix
def test_a_window_that_is_not_mapped_is_not_seen(screen: Screen, tmp_path: Path) -> None:
    with shown_window(tmp_path, screen) as window:
        hold(window)
        number = screen.xdotool("search", "--onlyvisible", "--name", "TAMS").split()[0]
        screen.xdotool("windowunmap", "--sync", number)
        lets_go_unseen(window)
        screen.xdotool("windowmap", "--sync", number)
        screen.focus("TAMS")
        is_seen_again(window)


@pytest.mark.matrix
@pytest.mark.parametrize(("name", "hidden"), [("LockedHint", True), ("Active", False)])
def test_what_a_lock_or_another_session_hides_is_not_seen(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, hidden: bool
) -> None:
    own = "tty" if hidden else ""
    with (
        logind(tmp_path, monkeypatch, own) as change,
        shown_window(tmp_path, screen) as window,
    ):
        hold(window)
        change(name, hidden)
        lets_go_unseen(window)
        change(name, not hidden)
        is_seen_again(window)


def test_a_locked_console_hides_no_window_of_another_graphical_session(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        logind(tmp_path, monkeypatch, "x11") as change,
        shown_window(tmp_path, screen) as window,
    ):
        hold(window)
        change("LockedHint", True)
        before = len(window.events)
        assert wait_for(lambda: len(window.events) > before + 50)
        assert all(event.focused for event in window.events[before:] if isinstance(event, Keys))


def test_a_window_that_cannot_ask_the_x_server_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        virtual_screen(tmp_path, monkeypatch, 640, 400, "-maxclients", "64") as screen,
        screen.full_but_for(1),
        pytest.raises(SetupError, match="takes no second connection"),
    ):
        FaceClient(MonotonicClock(), WINDOW).launch(tmp_path)
