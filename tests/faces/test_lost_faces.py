"""What becomes of a session whose window or headset is lost, or stands still."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from tams_app.console import app
from tams_app.faces import session_face
from tams_app.faces.session_face import SILENT_NS
from tams_app.printing import Console
from tests.faces.headset.steamvr import FAKED, steamvr
from tests.faces.played_session import PlayedSession, children_of
from tests.faces.window.xvfb import virtual_screen

pytestmark = pytest.mark.waiting

MODULES = {"window": "tams_app.faces.window.process", "headset": FAKED.module}


@pytest.fixture(params=MODULES)
def face(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """The one that is lost; the session has a window in any case."""
    monkeypatch.setattr(session_face, "HEADSET", FAKED)
    with virtual_screen(tmp_path, monkeypatch), steamvr(tmp_path, monkeypatch):
        yield request.param


def process_of(face: str) -> psutil.Process:
    return children_of(MODULES[face])[0]


def shown(face: str, folder: Path, do: Callable[[PlayedSession], None]) -> PlayedSession:
    """A session that is over; `do` is called once while it runs."""
    headset = {"headset.show": "always"} if face == "headset" else {}
    session = PlayedSession(folder / "session", "lite6.yaml", **headset)
    session.do = lambda: do(session)
    app.show_session(session, session, Console(quiet=True))
    assert not any(children_of(module) for module in MODULES.values())
    return session


def test_a_face_whose_process_is_killed_fails_the_session_and_the_arm_stops_first(
    face: str, tmp_path: Path
) -> None:
    session = shown(face, tmp_path, lambda _: process_of(face).kill())
    assert session.failure.startswith(f"the {face}'s process ended unasked")
    window = "no window" if face == "window" else "window open"
    assert session.done == [f"arm stopped, {window}"]


def test_a_face_that_stands_still_is_told_of_and_stops_a_real_arm(
    face: str, tmp_path: Path
) -> None:
    polls = silent_ns = stopped_ns = 0

    def put_a_frame(session: PlayedSession) -> None:
        put_ns, video = time.monotonic_ns(), session.config.video
        for view in video.views:
            image = np.zeros((video.height, video.width, 3), np.uint8)
            session.screen.put(view, 1, put_ns, image)
        session.do = lambda: stand_still(session, put_ns)

    def stand_still(session: PlayedSession, put_ns: int) -> None:
        nonlocal stopped_ns
        if any(
            (session.displays.seen_ns(view) or 0) < put_ns for view in session.config.video.views
        ):
            session.do = lambda: stand_still(session, put_ns)
            return
        stopped_ns = time.monotonic_ns()
        os.kill(process_of(face).pid, signal.SIGSTOP)
        session.do = lambda: go_on(session)

    def go_on(session: PlayedSession) -> None:
        nonlocal polls, silent_ns
        polls += 1
        if "estop" in session.done:
            silent_ns = time.monotonic_ns() - stopped_ns
            process_of(face).send_signal(signal.SIGCONT)
            session.end("seen")
        session.do = lambda: go_on(session)

    session = shown(face, tmp_path, put_a_frame)
    assert session.reason == "seen"
    assert any(f"the {face} does not answer" in note for note in session.notes)
    assert silent_ns > 0.9 * SILENT_NS  # it reported last a moment before
    assert polls > 10  # the session went on meanwhile
