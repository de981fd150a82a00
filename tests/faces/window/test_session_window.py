"""The window of a session: its keys, its end, and what becomes of a session that loses it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tams_app.console import app
from tams_app.errors import SetupError
from tams_app.faces.commands import Command
from tams_app.faces.messages import Ended, Pin, TrialFacts
from tams_app.faces.session_face import SessionWindow, facts_of
from tams_app.printing import Console
from tams_app.records import ControllerSample, ControllerStatus, SessionState, ViewState
from tams_app.robot.control import CONFIRMED_AGO_NS, TOO_LONG_AGO
from tams_app.teleop.clutch import Clutch
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faces.played_session import STATE, PlayedSession, window_processes
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for

# a window that does not paint for 150 ms takes no key
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

KEYBOARD = {"controller.device": "keyboard"}


@pytest.fixture
def session(tmp_path: Path) -> PlayedSession:
    return PlayedSession(tmp_path / "session")


def press(screen: Screen, *keys: str) -> None:
    screen.focus("TAMS")
    time.sleep(1.0)  # a key just after the focus may have been down before it
    screen.xdotool(*(word for key in keys for word in ("key", key)))


def show(session: PlayedSession) -> None:
    app.show_session(session, session, Console(quiet=True))
    assert window_processes() == []


def test_the_window_s_keys_confirm_stop_and_end(screen: Screen, session: PlayedSession) -> None:
    session.do = lambda: press(screen, "Return", "space", "q")
    show(session)
    assert session.reason == "ended by the operator"
    assert session.failure == ""
    assert session.done == ["confirm", "estop", "arm stopped, window open"]


def test_a_confirmation_that_a_session_takes_in_too_late_is_none(
    screen: Screen, session: PlayedSession
) -> None:
    late_s = 0.5 + CONFIRMED_AGO_NS / NS_PER_S
    session.signals.stop_with(lambda: time.sleep(late_s))  # what comes after it waits in the socket

    def stop_and_confirm() -> None:
        press(screen, "space", "Return")
        session.do = end_once_noted

    def end_once_noted() -> None:
        if f"warning: {TOO_LONG_AGO}" in session.notes:
            screen.xdotool("key", "q")
        else:
            session.do = end_once_noted

    session.do = stop_and_confirm
    show(session)
    assert session.reason == "ended by the operator"
    assert session.done == ["estop", "arm stopped, window open"]


def test_a_session_that_is_over_is_shown_with_its_result_until_it_is_answered(
    screen: Screen, session: PlayedSession
) -> None:
    session.do = lambda: session.end("the trial is over")
    with app.showing(session, session, Console(quiet=True), shows_end=True) as (face,):
        assert face.is_there
        face.show_end(Ended("Completed", ("Report: here",), "Q: close"))
        screen.focus("TAMS")
        screen.xdotool("key", "space")  # that was meant for the session
        time.sleep(0.5)
        assert face.answer is None
        time.sleep(1.0)
        screen.xdotool("key", "Return")
        assert wait_for(lambda: face.answer is Command.CONFIRM)
        screen.xdotool("mousemove", "1210", "43", "click", "1")
        assert wait_for(lambda: face.answer is Command.QUIT)
    assert session.done == ["arm stopped, window open"]
    assert session.failure == ""
    assert window_processes() == []


def test_closing_the_window_ends_the_session_whose_end_it_does_not_show(
    screen: Screen, session: PlayedSession
) -> None:
    session.do = lambda: screen.ask_to_close("TAMS")
    with app.showing(session, session, Console(quiet=True), shows_end=True) as (face,):
        assert (face.is_there, window_processes()) == (False, [])
    assert session.reason == "the operator closed the window"
    assert session.failure == ""
    assert session.done == ["arm stopped, window open"]


class CountedTrial:
    """A trial that notes what is asked of it."""

    def __init__(self, session: PlayedSession) -> None:
        self._done = session.done

    def mark(self, command: Command) -> None:
        self._done.append(str(command))

    def facts_of(self, _state: object) -> TrialFacts:
        return TrialFacts("P01", "trial 2 of 9", 3.0, 120.0)


@pytest.mark.parametrize("in_trial", [False, True])
def test_what_is_pinned_in_the_window_counts_but_in_no_trial_of_a_study(
    in_trial: bool, tmp_path: Path
) -> None:
    session = PlayedSession(tmp_path)
    trial = CountedTrial(session) if in_trial else None
    window = SessionWindow(session.config, tmp_path, trial)
    window._session = session
    for view in ("eih", ""):
        window._on_event(Pin(0, view))
        assert session.signals.pinned == ("" if in_trial else view)


def test_drops_are_counted_in_a_trial_and_its_end_is_marked_and_elsewhere_those_keys_do_nothing(
    screen: Screen, tmp_path: Path
) -> None:
    found = []
    for name in ("other", "trial"):
        session = PlayedSession(tmp_path / name)
        session.do = lambda: press(screen, "x", "x", "BackSpace", "p", "q")
        trial = CountedTrial(session) if name == "trial" else None
        app.show_session(session, session, Console(quiet=True), trial=trial)
        found.append([one for one in session.done if not one.startswith("arm stopped")])
    assert found == [[], ["a drop more", "a drop more", "a drop less", "placed"]]


def test_keys_held_in_the_window_move_the_hand_until_they_go_up_or_the_window_stands_still(
    screen: Screen, session: PlayedSession
) -> None:
    found: dict[str, ControllerSample] = {}

    def sample() -> ControllerSample:
        return session.keyboard.sample(time.monotonic_ns())

    def until(holds: Callable[[ControllerSample], bool]) -> ControllerSample:
        deadline_s = time.monotonic() + 60.0
        while not holds(one := sample()):
            assert time.monotonic() < deadline_s, one
            time.sleep(0.008)  # as the control loop samples it
        return one

    def drive() -> None:
        screen.focus("TAMS")
        until(lambda one: one.status is ControllerStatus.OK)
        time.sleep(1.0)  # a key just after the focus may have been down before it
        screen.xdotool("keydown", "Shift_L", "keydown", "w", "keydown", "c")
        found["held"] = until(lambda one: one.trigger == 1.0 and one.a)
        start = found["held"].pose.position
        found["moved"] = until(lambda one: np.linalg.norm(one.pose.position - start) > 0.02)
        screen.xdotool("keyup", "Shift_L")
        found["released"] = until(lambda one: one.trigger == 0.0)
        screen.xdotool("keydown", "Shift_L")
        until(lambda one: one.trigger == 1.0)
        window_processes()[0].suspend()
        found["still"] = until(lambda one: time.monotonic_ns() - one.buttons_ns > 500 * NS_PER_MS)
        window_processes()[0].resume()
        until(lambda one: time.monotonic_ns() - one.buttons_ns < 100 * NS_PER_MS)
        screen.xdotool("keyup", "Shift_L", "keyup", "w", "keyup", "c")
        session.end("driven")

    session.do = drive
    show(session)
    assert session.reason == "driven"
    assert session.failure == ""
    assert found["released"].status is ControllerStatus.OK
    assert found["still"].pose_ns < found["still"].buttons_ns + 200 * NS_PER_MS


def test_every_tap_of_the_mode_s_key_toggles_it_once_however_short_it_is(
    screen: Screen, session: PlayedSession
) -> None:
    clutch = Clutch(10_000 * NS_PER_MS)  # whatever the machine does meanwhile
    toggled = tapped = 0

    def sample() -> bool:
        nonlocal toggled
        now_ns = time.monotonic_ns()
        read = clutch.update(session.keyboard.sample(now_ns), now_ns)
        toggled += read.toggle_mode
        return read.released

    def tap() -> None:
        nonlocal tapped
        screen.focus("TAMS")
        assert wait_for(sample)
        time.sleep(1.0)  # a key just after the focus may have been down before it
        assert wait_for(sample)
        for tapped in range(1, 16):
            screen.xdotool("key", "--delay", "0", "m")  # down and up at once
            assert wait_for(lambda: sample() and toggled >= tapped, 10.0), tapped  # noqa: B023
        session.end("tapped")

    session.do = tap
    show(session)
    assert (session.reason, toggled) == ("tapped", tapped)


def test_keys_over_ssh_move_no_real_arm(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.2 51000 10.0.0.1 22")
    session = PlayedSession(tmp_path, "lite6.yaml", **KEYBOARD)
    with pytest.raises(SetupError, match="the desktop is remote"):
        app.show_session(session, session, Console(quiet=True))
    assert window_processes() == []


def test_without_a_display_that_answers_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    session = PlayedSession(tmp_path)
    with pytest.raises(SetupError, match=r"display does not answer; run with --headless"):
        app.show_session(session, session, Console(quiet=True))
    assert window_processes() == []


def test_without_a_display_there_is_no_window_and_no_hand_of_its_keys(
    session: PlayedSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    session.do = lambda: session.end(f"{len(window_processes())} windows")
    show(session)
    assert session.reason == "0 windows"
    with pytest.raises(SetupError, match="--hand keyboard needs the window"):
        show(PlayedSession(tmp_path / "keyboard", **KEYBOARD))


def test_the_size_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with virtual_screen(tmp_path, monkeypatch, 1920, 1080) as screen:

        def window() -> str:
            return screen.xdotool("search", "--sync", "--onlyvisible", "--name", "TAMS")

        def has_size() -> bool:
            shown = screen.xdotool("getwindowgeometry", "--shell", window()).split()
            return {"WIDTH=1000", "HEIGHT=600"} <= set(shown)

        def resize() -> None:
            screen.xdotool("windowsize", window(), "1000", "600")
            assert wait_for(has_size)
            screen.ask_to_close("TAMS")

        def look() -> None:
            assert wait_for(has_size)
            screen.ask_to_close("TAMS")

        for number, do in enumerate((resize, look)):
            session = PlayedSession(tmp_path / f"session{number}")
            session.do = do
            show(session)


def test_in_a_trial_the_window_is_told_nothing_of_what_is_compared() -> None:
    moving = msgspec.structs.replace(STATE, joints_urad=(1,) * 6, joints_ns=2, speed_scale=0.5)
    assert facts_of(moving, ()).state is moving, "outside a trial it is told everything"
    facts = facts_of(moving, (), TrialFacts("P01", "trial 2 of 9", 3.0, 120.0))
    state = facts.state
    assert (state.joints_urad, state.joints_ns, state.speed_scale) == ((), 0, 1.0)
    assert set(state.views.values()) == {ViewState()}
    told = {name for name in SessionState.__struct_fields__ if getattr(state, name) is not None}
    arm = {"arming", "reason", "lasting", "last_stop", "orientation_mode", "gripper_closed"}
    hand = {"hand", "pressed", "deadman", "tcp_mm", "phase", "primary_view"}
    nothing = {"joints_urad", "joints_ns", "speed_scale", "is_pinned"}
    assert told == arm | hand | {"t_s", "now_ns", "views", "placed"} | nothing
    assert facts.trial is not None
    assert (facts.trial.participant, state.arming) == ("P01", "holding")
