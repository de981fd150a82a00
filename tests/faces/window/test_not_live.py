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

from tams_app.faces.banner import look_of
from tams_app.records import Image
from tests.faces.window.photographs import is_colour
from tests.faces.window.xvfb import Screen, wait_for

pytestmark = pytest.mark.waiting


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
        [sys.executable, "-m", "tests.faces.window.stopped_session", str(folder / "session")]
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
