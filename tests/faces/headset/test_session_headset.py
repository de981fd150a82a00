"""The headset of a session: when there is one, and what becomes of a session that loses it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import openvr
import psutil
import pytest
from rich.console import Console

from tams_app.config import CONFIG_DIRECTORY, HeadsetConfig, load_config
from tams_app.console import app
from tams_app.errors import SetupError
from tams_app.faces.client import FaceClient
from tams_app.faces.headset import session_headset
from tams_app.faces.headset.session_headset import headset_is_wanted
from tams_app.runtime.clock import MonotonicClock
from tests.faces.headset.faked_process import ADDRESS
from tests.faces.headset.steamvr import FAKED, SteamVr, steamvr
from tests.faces.played_session import PlayedSession, children_of
from tests.faces.window.xvfb import virtual_screen, wait_for

pytestmark = pytest.mark.waiting

NO_OPENGL = r"^the headset needs OpenGL on an X display \((X11|GLX): [^;]*\); set headset\.show to"


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SteamVr]:
    """A faked SteamVR for the headset of the session that is shown next."""
    monkeypatch.setattr(session_headset, "HEADSET", FAKED)
    with virtual_screen(tmp_path, monkeypatch), steamvr(tmp_path, monkeypatch) as fake:
        yield fake


def headset_processes() -> list[psutil.Process]:
    return children_of(FAKED.module)


def shown(
    folder: Path, do: Callable[[PlayedSession], None], config: str = "tams.yaml"
) -> PlayedSession:
    """A session with window and headset, ended; `do` is called once while it runs."""
    session = PlayedSession(folder / "session", config, headset="always")
    session.folder.mkdir()
    session.do = lambda: do(session)
    app.show_session(session, Console(quiet=True))
    assert headset_processes() == []
    return session


def test_a_session_is_shown_in_the_headset_which_ends_with_it(
    found: SteamVr, tmp_path: Path
) -> None:
    def look(session: PlayedSession) -> None:
        def visible() -> bool:
            overlays = found.overlays().values()
            return len(overlays) == 4 and all(one.shown for one in overlays)

        assert wait_for(visible)
        session.end("seen")

    session = shown(tmp_path, look)
    assert session.reason == "seen"
    assert session.failure == ""
    assert session.notes == []


@pytest.mark.parametrize("config", ["tams.yaml", "lite6.yaml"])
def test_a_headset_whose_process_is_killed_fails_the_session_and_the_arm_stops_first(
    found: SteamVr, tmp_path: Path, config: str
) -> None:
    session = shown(tmp_path, lambda _: headset_processes()[0].kill(), config)
    assert session.failure.startswith("the headset's process ended unasked")
    assert session.done == ["arm stopped, window open"]


def test_a_headset_that_stands_still_is_told_of_and_stops_a_real_arm(
    found: SteamVr, tmp_path: Path
) -> None:
    polls = 0

    def stand_still(session: PlayedSession) -> None:
        os.kill(headset_processes()[0].pid, signal.SIGSTOP)
        session.do = lambda: go_on(session)

    def go_on(session: PlayedSession) -> None:
        nonlocal polls
        polls += 1
        if "estop" in session.done:
            headset_processes()[0].send_signal(signal.SIGCONT)
            session.end("seen")
        session.do = lambda: go_on(session)

    session = shown(tmp_path, stand_still, "lite6.yaml")
    assert session.reason == "seen"
    assert any("the headset does not answer" in note for note in session.notes)
    assert polls > 10  # the session went on meanwhile


def test_a_steamvr_that_quits_fails_the_session_and_the_arm_stops_first(
    found: SteamVr, tmp_path: Path
) -> None:
    session = shown(tmp_path, lambda _: found.ask("event", openvr.VREvent_Quit))
    assert session.failure == (
        "the headset shows nothing any more, so the operator sees nothing: SteamVR has quit"
    )
    assert session.done == ["arm stopped, window open"]


def test_a_steamvr_that_refuses_the_overlays_on_the_way_fails_the_session(
    found: SteamVr, tmp_path: Path
) -> None:
    def refuse(session: PlayedSession) -> None:
        assert wait_for(lambda: len(found.overlays()) == 4)
        found.ask("refuse", openvr.VROverlayError_RequestFailed)
        session.screen.put("eih", 1, 1, np.zeros((480, 640, 3), np.uint8))

    session = shown(tmp_path, refuse)
    assert session.failure.endswith("the connection to SteamVR broke (OverlayError_RequestFailed)")


def launch(folder: Path) -> None:
    client = FaceClient(MonotonicClock(), FAKED)
    try:
        client.launch(folder, headset=HeadsetConfig().model_dump())
    finally:
        client.close()


def test_without_steamvr_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(ADDRESS, raising=False)
    with pytest.raises(SetupError, match=r"^SteamVR is not installed[^;]*; set headset\.show to n"):
        launch(tmp_path)


@pytest.mark.parametrize("display", ["", ":4711"])
def test_without_a_display_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    monkeypatch.setenv("DISPLAY", display)
    with (
        steamvr(tmp_path, monkeypatch),
        pytest.raises(SetupError, match=NO_OPENGL),
    ):
        launch(tmp_path)


def test_without_opengl_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        virtual_screen(tmp_path, monkeypatch, 640, 480, "-extension", "GLX"),
        steamvr(tmp_path, monkeypatch),
        pytest.raises(SetupError, match=NO_OPENGL),
    ):
        launch(tmp_path)


@pytest.mark.parametrize(
    ("config", "overrides", "wanted"),
    [
        ("tams.yaml", {}, False),
        ("tams.yaml", {"headset.show": "always"}, True),
        ("tams.yaml", {"controller.device": "openvr"}, True),
        ("lite6.yaml", {}, True),
        ("lite6.yaml", {"controller.device": "keyboard"}, False),
        ("lite6.yaml", {"headset.show": "never"}, False),
    ],
)
def test_a_headset_belongs_to_a_tracked_hand_unless_the_configuration_says_otherwise(
    config: str, overrides: dict[str, str], wanted: bool
) -> None:
    assert headset_is_wanted(load_config(CONFIG_DIRECTORY / config, overrides)) is wanted
