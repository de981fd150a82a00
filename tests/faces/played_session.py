"""A session of which only the faces are real, and the processes of those."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil
from msgspec.structs import replace

from hw.desk.keyboard import KeyboardController
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.records import SessionState
from tams_app.robot.control import TOO_LONG_AGO, Signals
from tams_app.runtime.mailbox import Sentences
from tams_app.station.fresh_video import Displays
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window import facts

STATE = replace(
    facts.STATE,
    arming="holding",
    reason="stale video",
    lasting="stale video",
    last_stop="pose frozen",
)


class PlayedSession:
    """A session that shows nothing new, and notes what is asked of it and when."""

    mount = None  # all frames are shown as received
    recorded_mb = None

    def __init__(self, folder: Path, config: str = "tams.yaml", **overrides: object) -> None:
        self.config = load_config(CONFIG_DIRECTORY / config, {"headset.show": "never", **overrides})
        video = self.config.video
        self.screen = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        self.keyboard = KeyboardController(self.config.controller.desk, self.config.hand.rotation)
        self.keyboard.start()
        self.folder = folder
        folder.mkdir(exist_ok=True)
        self.sentences = Sentences()
        self.signals = Signals()
        self.displays = Displays()
        self.ended = threading.Event()
        self.failure = self.reason = ""
        self.notes: list[str] = []
        self.done: list[str] = []
        self.do: Callable[[], None] = lambda: None
        self._began_s = time.monotonic()

    def __enter__(self) -> PlayedSession:
        return self

    def poll(self) -> None:
        do, self.do = self.do, lambda: None
        do()
        self._take_in()
        if self.elapsed_s() > 120:
            self.end("nothing happened")

    def _take_in(self) -> None:
        pending = self.signals.take(time.monotonic_ns())
        if pending.late_confirm:
            self.note("warning", TOO_LONG_AGO)
        self.done += ["confirm"] * pending.confirm + ["estop"] * pending.estop

    def elapsed_s(self) -> float:
        return time.monotonic() - self._began_s

    def state(self) -> SessionState:
        now_ns = time.monotonic_ns()
        return replace(STATE, now_ns=now_ns, heard_ns=now_ns)

    def end(self, reason: str) -> None:
        self.reason = self.reason or reason
        self.ended.set()

    def fail(self, sentence: str) -> None:
        self.failure = sentence
        self.end(sentence)

    def request_end(self, reason: str) -> None:
        self.end(reason)

    def note(self, level: str, text: str) -> None:
        self.notes.append(f"{level}: {text}")

    def stop_arm(self) -> None:
        self._take_in()  # what came after the last poll, with the key that ends the session
        self.done.append(f"arm stopped, {'window open' if window_processes() else 'no window'}")

    def __exit__(self, *_: object) -> None:
        self.screen.close()


def children_of(module: str) -> list[psutil.Process]:
    """The processes of ours that run this module and have not ended."""
    found = []
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):  # it has ended, and its owner will notice
            if module in child.cmdline():
                found.append(child)
    return found


def window_processes() -> list[psutil.Process]:
    return children_of("tams_app.faces.window.process")
