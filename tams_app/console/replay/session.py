"""A log as the console meets a session: nothing moves, time goes as the person wants."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TypeAlias

import cv2
import msgspec
import numpy as np

from hw.desk.keyboard import KeyboardController
from tams_app.config import Config
from tams_app.console.replay.log_index import LogIndex, outline_of, phases_row
from tams_app.console.replay.marks import Marking
from tams_app.errors import UnreadableLogError
from tams_app.faces.commands import PHASE_KEYS
from tams_app.faces.messages import Keys, ReplayFacts
from tams_app.prediction.present import PREDICTED_FACT
from tams_app.recording import SessionLog
from tams_app.recording.reader import PictureFinder, ShownPicture
from tams_app.records import EpisodeRequest, Note, SessionState, without_figures
from tams_app.runtime.clock import Clock
from tams_app.runtime.mailbox import Sentences
from tams_app.station.fresh_video import Displays
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout

Action: TypeAlias = Callable[[], None]
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_STEP_NS = 5 * NS_PER_S
_FINE_NS = NS_PER_S // 10
_LONG_NS = 1 << 62


class Playback:
    """A position between the start and the end of a log [ns of the session's clock]."""

    def __init__(self, start_ns: int, end_ns: int, speed: float) -> None:
        """`speed`: times the real one; any above 0."""
        self.start_ns, self.end_ns = start_ns, max(start_ns, end_ns)
        self.position_ns = start_ns
        self.speed = speed
        self.paused = False
        self.jumps = 0  # how often it went elsewhere than on
        self._now_ns = 0

    @property
    def at_end(self) -> bool:
        return self.position_ns >= self.end_ns

    def begin(self, now_ns: int) -> None:
        """Go on from `now_ns`: what has passed until then does not count."""
        self._now_ns = now_ns

    def step(self, now_ns: int) -> int:
        """The position at `now_ns`; at the end it stays there."""
        passed_ns, self._now_ns = now_ns - self._now_ns, now_ns
        if not self.paused:
            self.position_ns = min(self.end_ns, self.position_ns + round(passed_ns * self.speed))
        return self.position_ns

    def toggle(self) -> None:
        """Pause, or go on; from the end go on from the start."""
        if self.at_end:
            self.seek(self.start_ns)
            self.paused = False
        else:
            self.paused = not self.paused

    def pause(self) -> None:
        """Stay here."""
        self.paused = True

    def seek(self, position_ns: int) -> None:
        """Go there, but no further than there is a log."""
        self.position_ns = min(self.end_ns, max(self.start_ns, position_ns))
        self.jumps += 1

    def move(self, by_ns: int) -> None:
        """Forward or back, as `seek`."""
        self.seek(self.position_ns + by_ns)

    def faster(self, steps: int) -> None:
        """Take the speed that is so many steps up (down, where negative) in `SPEEDS`."""
        nearest = min(range(len(SPEEDS)), key=lambda at: abs(SPEEDS[at] - self.speed))
        self.speed = SPEEDS[min(len(SPEEDS) - 1, max(0, nearest + steps))]


class PlaybackRequests:
    """Requests to a playback, by any thread or signal; `carry_out` does it, in one thread."""

    def __init__(self, playback: Playback) -> None:
        self.pinned = ""  # for those who look on: the log says what was pinned
        self._playback = playback
        self._asked: SimpleQueue[Action] = SimpleQueue()

    def ask(self, action: Action) -> None:
        self._asked.put(action)

    def confirm(self, asked_ns: int) -> None:
        self.ask(self._playback.toggle)

    def estop(self) -> None:
        self.ask(self._playback.pause)

    def episode(self, request: EpisodeRequest) -> None:
        """Nothing: what has become of an episode is in the log."""

    def carry_out(self) -> None:
        while not self._asked.empty():
            self._asked.get()()


class ReplaySession:
    """Satisfies what the console needs of a session; from one thread, but for what is asked.

    A context, in which time passes.
    """

    keyboard: KeyboardController | None = None
    mount: MountMemory | None = None  # pictures are shown as received
    recorded_mb: float | None = None  # it records nothing
    failure = ""

    def __init__(
        self,
        log: SessionLog,
        pictures: PictureFinder,
        config: Config,
        folder: Path,
        speed: float,
        clock: Clock,
        key_help: str = "",
        marking: Marking | None = None,
    ) -> None:
        """`config`: the session's own. `folder`: for what the window's process writes.

        `key_help`: which keys there are, to be shown behind the progress. `marking`: of this log,
        by keys; it goes on, paused, from the last mark.
        """
        self.config, self.folder = config, folder
        self.sentences = Sentences()
        self.displays = Displays()
        self.ended = threading.Event()
        self._log, self._pictures = log, pictures
        self._index = LogIndex(log)
        self._clock, self._key_help = clock, key_help
        self.blind = marking is not None
        self._marking = marking
        self.outline = outline_of(log)
        if self.blind:  # who marks does not know what was inferred
            self.outline = msgspec.structs.replace(self.outline, phases=())
        self.playback = Playback(log.header.started_ns, log.ended_ns, speed)
        self.signals = PlaybackRequests(self.playback)
        if marking is not None:
            self.playback.pause()
            if marking.marks:
                self._go_to(marking.marks[-1].t_s)
        self._noted_ns = log.header.started_ns - NS_PER_S
        self._note: Note | None = None
        self._past: tuple[SessionState, ...] = ()  # before the last jump
        self._presses: Mapping[str, int] = {}
        self._announced = ""
        self._shown: dict[str, int] = {}
        video = config.video
        self.screen = FrameBlock(RingLayout(SHOWN, log.header.views, video.width, video.height))

    def __enter__(self) -> ReplaySession:
        """Begin now: the time that the window took to open does not count."""
        self.playback.begin(self._clock.now_ns())
        if predicted := self._log.facts.get(PREDICTED_FACT):
            views = ", ".join(predicted.split(","))
            self.sentences.note(f"as received, while the session showed them predicted: {views}")
        return self

    def poll(self) -> None:
        """Go on by the time that has passed; show what belongs there."""
        jumps = self.playback.jumps
        self.signals.carry_out()
        position_ns = self.playback.step(self._clock.now_ns())
        jumped = self.playback.jumps != jumps
        if jumped and not self.blind:
            self._past = self._index.rates_before(position_ns)
        self._show_notes(position_ns, jumped)
        self._show_progress()
        self._put_pictures(position_ns, jumped)
        if self.config.headless and self.playback.at_end:
            self.end("the log is over")  # without a window there are no keys to go back

    def elapsed_s(self) -> float:
        """The replay's position, in the session's own time."""
        return (self.playback.position_ns - self._log.header.started_ns) / NS_PER_S

    def state(self) -> SessionState:
        """The state as it was shown; where phases are marked, with the mark and without figures."""
        state = self._index.at(self.playback.position_ns)
        if self._marking is None:
            return state
        mark = self._marking.mark_at(state.t_s)
        return msgspec.structs.replace(
            without_figures(state), phase="" if mark is None else mark.name, primary_view=""
        )

    def facts(self) -> ReplayFacts:
        """Its speed, whether it is paused, its jumps, and the marks."""
        playback, marks = self.playback, None
        if self._marking is not None:
            changes = ((round(mark.t_s * NS_PER_S), mark.name) for mark in self._marking.marks)
            marks = phases_row(self._log, changes)
        paused = playback.paused or playback.at_end
        return ReplayFacts(playback.speed, paused, playback.jumps, marks, self._past)

    def on_keys(self, keys: Keys) -> None:
        """Do what each new press asks for. From one thread."""
        for key, count in keys.presses.items():
            for _ in range(count - self._presses.get(key, 0)):
                self.signals.ask(partial(self._do, key))
        self._presses = keys.presses

    def seek(self, t_s: float) -> None:
        """Go to that moment of the log [s], in any thread."""
        self.signals.ask(partial(self._go_to, t_s))

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
        """Nothing: there is no arm."""

    def __exit__(self, *_: object) -> None:
        """Do what was requested just before the end, too: no mark is lost."""
        try:
            self.signals.carry_out()
        finally:
            self.screen.close()

    def _do(self, key: str) -> None:
        """Do what a key is for that is no command, by its name in GDK; others change nothing."""
        playback, marking = self.playback, self._marking
        match key:
            case "Left":
                playback.move(-_STEP_NS)
            case "Right":
                playback.move(_STEP_NS)
            case "Home":
                playback.move(-_LONG_NS)
            case "End":
                playback.move(_LONG_NS)
            case "Up":
                playback.faster(1)
            case "Down":
                playback.faster(-1)
            case "Page_Up":
                self._go_a_little(-_FINE_NS)
            case "Page_Down":
                self._go_a_little(_FINE_NS)
            case "g":
                self._go_to_gripper()
            case "BackSpace" if marking is not None:
                self.sentences.note(marking.undo(self.elapsed_s()))
            case _ if marking is not None and key in PHASE_KEYS:
                self.sentences.note(marking.begin(PHASE_KEYS[key], self.elapsed_s()))

    def _go_to(self, t_s: float) -> None:
        self.playback.seek(self._log.header.started_ns + round(t_s * NS_PER_S))

    def _go_a_little(self, by_ns: int) -> None:
        self.playback.pause()
        self.playback.move(by_ns)

    def _go_to_gripper(self) -> None:
        """Go to the next tick before which the gripper was commanded to open or close."""
        ticks = [tick for tick in self._log.ticks if tick.arm is not None]
        closed = [bool(tick.arm and tick.arm.gripper_closed) for tick in ticks]
        for tick, before, after in zip(ticks[1:], closed, closed[1:], strict=False):
            if before != after and tick.started_ns > self.playback.position_ns:
                self.playback.seek(tick.started_ns)
                return

    def _show_notes(self, position_ns: int, jumped: bool) -> None:
        """Show the sentences passed on the way; after a jump only the last one before."""
        notes = self._index.notes_between(0 if jumped else self._noted_ns, position_ns)
        if jumped:
            notes = [note for note in notes[-1:] if note is not self._note]
        for note in notes:
            self.sentences.note(note.text)
            self._note = note
        self._noted_ns = position_ns

    def _show_progress(self) -> None:
        """Show the replay's state, whenever that changes."""
        playback = self.playback
        state = "the end" if playback.at_end else "paused" if playback.paused else "goes on"
        times = "" if playback.speed == 1.0 else f"{playback.speed:g} times "
        progress = f"replay: {state}, {times}the real speed"
        if progress != self._announced:
            self._announced = progress
            is_over = self.config.headless and playback.at_end
            self.sentences.note(progress if is_over else f"{progress}{self._key_help}")

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
