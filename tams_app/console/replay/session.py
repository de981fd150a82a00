"""A log as the console meets a session: nothing moves, time goes as the person wants."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import Final

import cv2
import numpy as np

from hw.desk.keyboard import KeyboardController
from tams_app.config import Config
from tams_app.console.replay.moments import Moments
from tams_app.console.replay.outline import outline_of
from tams_app.console.replay.playback import STEP_NS, Playback
from tams_app.errors import UnreadableLogError
from tams_app.faces.messages import Keys, ReplayFacts
from tams_app.recording import SessionLog
from tams_app.recording.pictures import PictureFinder, ShownPicture
from tams_app.records import Note, SessionState
from tams_app.session.sentences import Sentences
from tams_app.station.displays import Displays
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout

KEY_STEPS: Final = {"Left": -STEP_NS, "Right": STEP_NS, "Home": -(1 << 62), "End": 1 << 62}
KEY_SPEEDS: Final = {"Up": 1, "Down": -1}


class Requests:
    """Requests to a playback, by any thread or signal; `carry_out` does it, in one thread."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self._asked: SimpleQueue[Callable[[], None]] = SimpleQueue()

    def confirm(self, asked_ns: int | None = None) -> None:
        self._asked.put(self._playback.toggle)

    def estop(self) -> None:
        self._asked.put(self._playback.pause)

    def press(self, key: str) -> None:
        """An arrow key, Home or End; others change nothing."""
        if key in KEY_STEPS:
            self._asked.put(lambda: self._playback.move(KEY_STEPS[key]))
        elif key in KEY_SPEEDS:
            self._asked.put(lambda: self._playback.faster(KEY_SPEEDS[key]))

    def seek(self, position_ns: int) -> None:
        self._asked.put(lambda: self._playback.seek(position_ns))

    def carry_out(self) -> None:
        while not self._asked.empty():
            self._asked.get()()


class ReplaySession:
    """Satisfies what the console needs of a session; from one thread, but for what is asked."""

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
        key_help: str = "",
    ) -> None:
        """`config`: the session's own. `folder`: for what the window's process writes.

        `key_help`: which keys there are, to be told behind how it goes.
        """
        self.config, self.folder = config, folder
        self.sentences = Sentences()
        self.displays = Displays()
        self.ended = threading.Event()
        self._log, self._pictures = log, pictures
        self._moments = Moments(log)
        self._now_ns, self._key_help = now_ns, key_help
        self.outline = outline_of(log)
        self.playback = Playback(log.header.started_ns, log.ended_ns, speed)
        self.signals = Requests(self.playback)
        self._noted_ns = log.header.started_ns - NS_PER_S
        self._note: Note | None = None
        self._held: frozenset[str] = frozenset()
        self._told = ""
        self._shown: dict[str, int] = {}
        video = config.video
        self.screen = FrameBlock(RingLayout(SHOWN, log.header.views, video.width, video.height))

    def start(self) -> None:
        """Begin now: the time that the window took to open does not count."""
        self.playback.begin(self._now_ns())

    def poll(self) -> None:
        """Go on by the time that has passed; show what belongs there."""
        jumps = self.playback.jumps
        self.signals.carry_out()
        position_ns = self.playback.step(self._now_ns())
        jumped = self.playback.jumps != jumps
        self._say_notes(position_ns, jumped)
        self._tell()
        self._put_pictures(position_ns, jumped)
        if self.config.headless and self.playback.at_end:
            self.end("the log is over")  # without a window there are no keys to go back

    def elapsed_s(self) -> float:
        """The replay's position, in the session's own time."""
        return (self.playback.position_ns - self._log.header.started_ns) / NS_PER_S

    def state(self) -> SessionState:
        return self._moments.at(self.playback.position_ns)

    def facts(self) -> ReplayFacts:
        """Its speed, whether it is paused, and its jumps."""
        playback = self.playback
        return ReplayFacts(playback.speed, playback.paused or playback.at_end, playback.jumps)

    def on_keys(self, keys: Keys) -> None:
        """Arrow keys: 5 s back and forth, faster and slower; Home and End. From one thread."""
        held = frozenset(keys.held)
        for key in held - self._held:
            self.signals.press(key)
        self._held = held

    def seek(self, t_s: float) -> None:
        """Go to that moment of the log [s], in any thread."""
        self.signals.seek(self._log.header.started_ns + round(t_s * NS_PER_S))

    def request_end(self, reason: str) -> None:
        self.end(reason)

    def end(self, reason: str) -> None:
        self.ended.set()

    def fail(self, sentence: str) -> None:
        self.failure = sentence
        self.ended.set()

    def note(self, level: str, text: str) -> None:
        self.sentences.note(text)

    def stop_arm(self) -> None:
        """There is none."""

    def close(self) -> None:
        self.screen.close()

    def _say_notes(self, position_ns: int, jumped: bool) -> None:
        """Show the sentences passed on the way; after a jump only the last one before."""
        notes = self._moments.notes_between(0 if jumped else self._noted_ns, position_ns)
        if jumped:
            notes = [note for note in notes[-1:] if note is not self._note]
        for note in notes:
            self.sentences.note(note.text)
            self._note = note
        self._noted_ns = position_ns

    def _tell(self) -> None:
        """Show the replay's state, whenever that changes."""
        playback = self.playback
        state = "the end" if playback.at_end else "paused" if playback.paused else "goes on"
        told = f"replay: {state}, {playback.speed:g} times the speed"
        if told != self._told:
            self._told = told
            is_over = self.config.headless and playback.at_end
            self.sentences.note(told if is_over else f"{told}{self._key_help}")

    def _put_pictures(self, position_ns: int, jumped: bool) -> None:
        try:
            found = self._pictures.at(position_ns + self._log.header.wall_offset_ns)
        except UnreadableLogError as error:
            self.fail(str(error))
            return
        if jumped:
            self._take_away(found)
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

    def _take_away(self, found: Mapping[str, ShownPicture]) -> None:
        """Black where the pictures are not known that belong to a moment."""
        video = self.config.video
        for view in self._shown.keys() - found.keys():
            del self._shown[view]
            self.screen.put(view, 0, 0, np.zeros((video.height, video.width, 3), np.uint8))
