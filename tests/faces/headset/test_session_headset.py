"""The headset of a session: when there is one, and what becomes of a session that loses it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import openvr
import pytest

from tams_app.config import CONFIG_DIRECTORY, HeadsetConfig, load_config
from tams_app.console import app
from tams_app.errors import SetupError
from tams_app.faces import session_face
from tams_app.faces.client import FaceClient
from tams_app.faces.session_face import headset_is_wanted
from tams_app.printing import Console
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
    monkeypatch.setattr(session_face, "HEADSET", FAKED)
    with virtual_screen(tmp_path, monkeypatch), steamvr(tmp_path, monkeypatch) as fake:
        yield fake


def shown(
    folder: Path, do: Callable[[PlayedSession], None], config: str = "tams.yaml"
) -> PlayedSession:
    """A session with window and headset, ended; `do` is called once while it runs."""
    session = PlayedSession(folder / "session", config, **{"headset.show": "always"})
    session.do = lambda: do(session)
    app.show_session(session, session, Console(quiet=True))
    assert children_of(FAKED.module) == []
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


def test_a_steamvr_that_quits_fails_the_session_and_the_arm_stops_first(
    found: SteamVr, tmp_path: Path
) -> None:
    session = shown(tmp_path, lambda _: found.ask("event", openvr.VREvent_Quit))
    assert session.failure == (
        "the headset shows nothing any more, so the operator sees nothing: SteamVR has quit"
    )
    assert session.done == ["arm stopped, window open"]


def launch(folder: Path) -> None:
    FaceClient(MonotonicClock(), FAKED).launch(folder, headset=HeadsetConfig().model_dump())


def test_without_steamvr_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(ADDRESS, raising=False)
    with pytest.raises(SetupError, match=r"^SteamVR is not installed[^;]*; set headset\.show to n"):
        launch(tmp_path)


@pytest.mark.parametrize("display", [":4711", "without GLX"])
def test_without_a_display_or_opengl_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    with ExitStack() as stack:
        if display == "without GLX":
            screen = virtual_screen(tmp_path, monkeypatch, 640, 480, "-extension", "GLX")
            stack.enter_context(screen)
        else:
            monkeypatch.setenv("DISPLAY", display)
        stack.enter_context(steamvr(tmp_path, monkeypatch))
        with pytest.raises(SetupError, match=NO_OPENGL):
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
