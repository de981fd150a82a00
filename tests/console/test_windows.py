"""The views' windows on a real X server without a screen."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.console.windows import ViewWindow
from tams_app.errors import SetupError
from tams_app.records import Image, ShownFrame

pytestmark = pytest.mark.timed

SCREEN_WIDTH, SCREEN_HEIGHT = 800, 600


@pytest.fixture
def screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Image]]:
    """An X server whose screen is a file; gives a function that takes a frame of it (BGR)."""
    if shutil.which("Xvfb") is None:
        pytest.skip("needs Xvfb (apt-get install xvfb)")
    reading, writing = os.pipe()
    geometry = f"{SCREEN_WIDTH}x{SCREEN_HEIGHT}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", geometry, "-fbdir", str(tmp_path)],
        pass_fds=(writing,),
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as number:
        monkeypatch.setenv("DISPLAY", f":{number.readline().strip()}")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))

    def photograph() -> Image:
        dump = (tmp_path / "Xvfb_screen0").read_bytes()  # XWD: header, colour map, BGRX rows
        pixels = np.frombuffer(dump[-SCREEN_WIDTH * SCREEN_HEIGHT * 4 :], np.uint8)
        return pixels.reshape(SCREEN_HEIGHT, SCREEN_WIDTH, 4)[:, :, :3]

    yield photograph
    server.terminate()
    server.wait(10)


def shown(index: int, colour: tuple[int, int, int], view: str = "eih") -> ShownFrame:
    image = np.zeros((480, 640, 3), np.uint8)
    image[:] = colour
    return ShownFrame(view, index, 1_000_000_000 + index * 33_000_000, image, 0)


def share_of(photograph: Image, colour: tuple[int, int, int]) -> float:
    """The share of a 640x480 window that has `colour`, give or take the YUV round trip."""
    near = np.abs(photograph.astype(int) - np.array(colour)).max(axis=2) < 12
    return float(near.sum() / (640 * 480))


def wait_for(condition: Callable[[], bool], timeout_s: float = 20.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.03)
    return condition()


def test_the_newest_frame_is_on_the_screen(screen: Callable[[], Image]) -> None:
    window = ViewWindow("eih", VideoConfig())
    window.open()
    try:
        window.show(shown(0, (30, 180, 60)))
        assert wait_for(lambda: share_of(screen(), (30, 180, 60)) > 0.95)
        window.show(shown(1, (200, 40, 120)))
        assert wait_for(lambda: share_of(screen(), (200, 40, 120)) > 0.95)
        assert share_of(screen(), (200, 40, 120)) < 1.0  # the view's name is in the frame
        assert window.poll() == ""
    finally:
        window.close()
        window.close()


def test_a_frame_already_shown_costs_nothing(screen: Callable[[], Image]) -> None:
    window = ViewWindow("gt", VideoConfig())
    window.open()
    frame = shown(4, (30, 180, 60), "gt")
    for _ in range(5):
        window.show(frame)
    assert window.frames_shown == 1
    window.close()


def test_the_frame_of_the_mailbox_is_not_written_on(screen: Callable[[], Image]) -> None:
    window = ViewWindow("gt", VideoConfig())
    window.open()
    frame = shown(0, (30, 180, 60), "gt")
    window.show(frame)
    window.close()
    assert (frame.image == np.array((30, 180, 60))).all()


def test_without_a_display_one_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(SetupError, match=r"no display .* run with --headless"):
        ViewWindow("eih", VideoConfig())


def test_a_display_that_does_not_answer_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(SetupError, match=r"display does not answer .* run with --headless"):
        ViewWindow("eih", VideoConfig())


def test_a_window_whose_display_is_gone_says_so(screen: Callable[[], Image]) -> None:
    window = ViewWindow("gs", VideoConfig())
    window.open()
    try:
        window._pipeline.get_bus().post(_output_window_closed(window))
        assert "window of view gs was closed" in window.poll()
        assert "window of view gs was closed" in window.poll()
    finally:
        window.close()


def _output_window_closed(window: ViewWindow) -> object:
    """The message that display sinks post when the operator closes their window."""
    modules = gst.load()
    error = modules.GLib.Error.new_literal(
        modules.Gst.ResourceError.quark(), "Output window was closed", 4
    )
    return modules.Gst.Message.new_error(window._pipeline, error, "")
