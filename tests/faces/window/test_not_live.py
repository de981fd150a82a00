"""A window whose session stands still says so, and is live again once the session is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from tams_app.console import app
from tams_app.faces.banner import look_of
from tams_app.printing import Console
from tams_app.records import Image, SessionState
from tests.faces.played_session import PlayedSession
from tests.faces.window.photographs import is_colour
from tests.faces.window.xvfb import Screen, wait_for

pytestmark = pytest.mark.waiting


class EngagedSession(PlayedSession):
    """The arm follows, the deadman is held, and all views have a picture."""

    def state(self) -> SessionState:
        return replace(super().state(), arming="engaged", reason="", lasting="", last_stop="")

    def poll(self) -> None:
        super().poll()
        video = self.config.video
        for number, view in enumerate(video.views):
            image = np.full((video.height, video.width, 3), (60, 90, 200), np.uint8)
            image[:, : 80 * (number + 1)] = (200, 120, 40)
            self.screen.put(view, 1, 1, image)


def banner_is(photograph: Image, arming: str) -> bool:
    """Whether the banner has that state's colour."""
    return bool(is_colour(photograph[8:78, 300:1100], look_of(arming).colour).mean() > 0.5)


def colourfulness(photograph: Image) -> float:
    """Mean difference of the colours of what is below the banner."""
    below = photograph[120:].astype(int)
    return float(np.ptp(below, axis=2).mean())


@contextmanager
def session_process(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.faces.window.test_not_live", str(folder / "session")]
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(20)


def test_a_window_whose_session_is_stopped_says_not_live_and_greys_itself(
    screen: Screen, tmp_path: Path
) -> None:
    with session_process(tmp_path) as process:
        assert wait_for(lambda: banner_is(screen.photograph(), "engaged"))
        assert wait_for(lambda: colourfulness(screen.photograph()) > 20)
        live = colourfulness(screen.photograph())
        os.kill(process.pid, signal.SIGSTOP)
        assert wait_for(lambda: banner_is(screen.photograph(), "not live"))
        assert wait_for(lambda: colourfulness(screen.photograph()) < live / 4)
        first = screen.photograph()
        assert wait_for(lambda: bool((screen.photograph()[:110] != first[:110]).any())), (
            "the time since goes on"
        )
        os.kill(process.pid, signal.SIGCONT)
        assert wait_for(lambda: banner_is(screen.photograph(), "engaged"))
        assert wait_for(lambda: colourfulness(screen.photograph()) > live / 2)


if __name__ == "__main__":  # the process of a session that is stopped
    session = EngagedSession(Path(sys.argv[1]))
    app.show_session(session, session, Console(quiet=True))
