"""A log as the console meets a session: nothing moves, time goes as the person wants."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from hw.desk.keyboard import KeyboardController
from tams_app.config import Config
from tams_app.console.replay.moments import Moments
from tams_app.console.replay.playback import STEP_NS, Playback
from tams_app.console.window.messages import Keys
from tams_app.errors import UnreadableLogError
from tams_app.recording import SessionLog
from tams_app.recording.pictures import PictureFinder
from tams_app.session.faces import Faces
from tams_app.session.status import StatusBoard, StatusSnapshot
from tams_app.units import NS_PER_S
from tams_app.video.frame_ring import SHOWN, FrameBlock, RingLayout

KEY_STEPS: Final = {"Left": -STEP_NS, "Right": STEP_NS, "Home": -(1 << 62), "End": 1 << 62}
KEY_SPEEDS: Final = {"Up": 1, "Down": -1}


class Requests:
    """Enter pauses and goes on, space pauses."""

    def __init__(self, playback: Playback) -> None:
        self.faces = Faces()
        self._playback = playback

    def confirm(self) -> None:
        self._playback.toggle()

    def estop(self) -> None:
        self._playback.paused = True


class ReplaySession:
    """Satisfies what the console needs of a session; from one thread but for keys."""

    keyboard: KeyboardController | None = None
    failure = ""

    def __init__(
        self,
        log: SessionLog,
        pictures: PictureFinder,
        config: Config,
        folder: Path,
        speed: float,
        now_ns: Callable[[], int],
    ) -> None:
        """`config`: the session's own. `folder`: for what the window's process writes."""
        self.config, self.folder = config, folder
        self.board = StatusBoard(log.header.views)
        self.ended = threading.Event()
        self._log, self._pictures = log, pictures
        self._moments = Moments(log)
        self._now_ns = now_ns
        self.playback = Playback(log.header.started_ns, log.ended_ns, speed, now_ns())
        self.signals = Requests(self.playback)
        self._noted_ns = log.header.started_ns - NS_PER_S
        self._held: frozenset[str] = frozenset()
        self._told = ""
        self._shown: dict[str, int] = {}
        video = config.video
        self.screen = FrameBlock(RingLayout(SHOWN, log.header.views, video.width, video.height))

    def start(self) -> None:
        """Nothing has to be started."""

    def poll(self) -> None:
        """Go on by the time that has passed; show what belongs there."""
        before_ns = self._noted_ns
        position_ns = self.playback.step(self._now_ns())
        for note in self._moments.notes_between(before_ns, position_ns):
            self.board.note(note.text)
        self._noted_ns = position_ns
        self._tell()
        self._put_pictures(position_ns)
        if self.config.headless and self.playback.at_end:
            self.end("the log is over")  # without a window there are no keys to go back

    def elapsed_s(self) -> float:
        """Where the replay is, in the session's own time."""
        return (self.playback.position_ns - self._log.header.started_ns) / NS_PER_S

    def snapshot(self) -> StatusSnapshot:
        return self._moments.at(self.playback.position_ns)

    def on_keys(self, keys: Keys) -> None:
        """Arrow keys: 5 s back and forth, faster and slower; Home and End."""
        held = frozenset(keys.held)
        for key in held - self._held:
            self.playback.move(KEY_STEPS.get(key, 0))
            self.playback.faster(KEY_SPEEDS.get(key, 0))
        self._held = held

    def request_end(self, reason: str) -> None:
        self.end(reason)

    def end(self, reason: str) -> None:
        self.ended.set()

    def fail(self, sentence: str) -> None:
        self.failure = sentence
        self.ended.set()

    def note(self, level: str, text: str) -> None:
        self.board.note(text)

    def stop_arm(self) -> None:
        """There is none."""

    def close(self) -> None:
        self.screen.close()

    def _tell(self) -> None:
        """How the replay goes, whenever that changes."""
        playback = self.playback
        state = "the end" if playback.at_end else "paused" if playback.paused else "goes on"
        told = f"replay: {state}, {playback.speed:g} times the speed"
        if told != self._told:
            self._told = told
            self.board.note(f"{told} (Enter: pause, go on; arrows: 5 s, slower, faster; q: end)")

    def _put_pictures(self, position_ns: int) -> None:
        try:
            found = self._pictures.at(position_ns + self._log.header.wall_offset_ns)
        except UnreadableLogError as error:
            self.fail(str(error))
            return
        video = self.config.video
        for view, picture in found.items():
            if self._shown.get(view) == picture.shown_ns:
                continue
            self._shown[view] = picture.shown_ns
            decoded = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
            if decoded is None:
                continue
            image = np.asarray(cv2.resize(decoded, (video.width, video.height)), np.uint8)
            shown_ns = picture.shown_ns - self._log.header.wall_offset_ns
            self.screen.put(view, shown_ns, shown_ns, image)
