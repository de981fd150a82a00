"""The session as a face sees it, and a face of a session that is a process of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

from msgspec.structs import replace

from hw.desk.keyboard import KeyboardController
from tams_app.config import Config
from tams_app.faces.client import Face, FaceClient
from tams_app.faces.commands import Action, Command, CommandedSession
from tams_app.faces.messages import (
    Event,
    FaceClosed,
    FaceFacts,
    Keys,
    Notice,
    Outline,
    ReplayFacts,
    TrialFacts,
)
from tams_app.records import SessionState, without_figures
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.worker import Worker
from tams_app.station.fresh_video import Displays
from tams_app.station.mount_memory import MountMemory
from tams_app.teleop.advice import what_to_do
from tams_app.teleop.hands import words_of_hand
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import FrameBlock

EVERY_NS = NS_PER_S // 10  # facts for the face
SILENT_NS = 2 * NS_PER_S  # of a face that reports 50 times a second
OPENING_NS = 10 * NS_PER_S  # until it reports the first time
_NOTICES, _LONGEST_SENTENCE = 3, 500


class FacedSession(CommandedSession, Protocol):
    """The session as a face sees it."""

    config: Config
    """Its whole configuration."""
    folder: Path
    """Its folder in the logs, which exists."""

    @property
    def displays(self) -> Displays:
        """The displays that the operator steers by; a face adds itself when it opens."""

    @property
    def recorded_mb(self) -> float | None:
        """Size of its log so far; None where it has none."""

    @property
    def screen(self) -> FrameBlock:
        """Shared memory with the newest decoded frame of each view."""

    @property
    def mount(self) -> MountMemory | None:
        """Shared memory with the place of the camera on the arm; None: no frames are corrected."""

    @property
    def keyboard(self) -> KeyboardController | None:
        """The controller that a window's keys drive; None: another controller is in use."""

    def fail(self, sentence: str) -> None:
        """End the session as failed.

        Args:
            sentence: the cause.
        """

    def note(self, level: str, text: str) -> None:
        """Write a sentence into the log and show it.

        Args:
            level: info, warning or error.
            text: the sentence.
        """

    def elapsed_s(self) -> float:
        """Time since the session's start [s]; of a replay the time in its log."""

    def state(self) -> SessionState:
        """The session as it stands."""


class ShownTrial(Protocol):
    """A trial of a study: all that a face may show of its session."""

    @property
    def actions(self) -> Mapping[Command, Action]:
        """The actions of the commands that exist in a trial only."""

    def facts_of(self, state: SessionState) -> TrialFacts:
        """The trial as it stands.

        Args:
            state: of its session, now.

        Returns:
            Who does which trial, its time and what was marked.
        """


class ShownReplay(Protocol):
    """A session that is a replay, as a face shows and steers it."""

    @property
    def outline(self) -> Outline:
        """Its log in outline, as the timeline shows it."""

    def facts(self) -> ReplayFacts:
        """Its speed, and whether it is paused."""

    @property
    def blind(self) -> bool:
        """Whether nothing may be shown that infers the phases of its log."""

    def on_keys(self, keys: Keys) -> None:
        """Take in the keys pressed; called in a thread of the window.

        Args:
            keys: all that are down, and how often each was pressed.
        """

    def seek(self, t_s: float) -> None:
        """Go to a moment of the log; called in the same thread.

        Args:
            t_s: time since the start of the log [s].
        """


class SessionFace:
    """Launched and opened, it follows the session until it is closed; `refresh` it often.

    What the operator steers by must be alive: where its process ends, or shows nothing any more,
    the session fails; where it stands still, its pictures count as old, and a person's arm gets
    an emergency stop.
    """

    def __init__(
        self,
        session: FacedSession,
        face: Face,
        trial: ShownTrial | None = None,
        replay: ShownReplay | None = None,
        **specification: Any,
    ) -> None:
        """`specification`: what its process is started with, besides its socket."""
        self._session, self._trial, self._replay = session, trial, replay
        self._specification = specification
        self._clock = MonotonicClock()
        self._client = FaceClient(self._clock, face)
        self._name = face.name
        self._notices: deque[Notice] = deque(maxlen=_NOTICES)
        self._stack = ExitStack()
        self._next_ns = 0
        self._opened_ns = 0
        self._silent = False
        self._gone = False
        self._worker: Worker | None = None

    def launch(self) -> None:
        """Start its process, before the session has the processor.

        Raises:
            SetupError: it cannot show anything here.
        """
        logs = self._session.folder / "helpers"
        logs.mkdir(exist_ok=True)
        self._client.launch(logs, **self._specification)
        self._stack.callback(self._client.close)

    def open(self) -> None:
        """Show it, once the session has started."""
        session = self._session
        replay = self._replay
        blind = self._trial is not None or (replay is not None and replay.blind)
        outline = None if replay is None else replay.outline
        self._client.open(session.config, session.screen, blind, outline, session.mount)
        self._opened_ns = self._clock.now_ns()
        if not session.config.operator_is_simulated:
            session.displays.add(lambda view: self._client.seen_ns.get(view, self._opened_ns))
        self._listen(self._on_event)

    def notify(self, text: str) -> None:
        """A sentence for the operator."""
        self._notices.append(Notice(self._session.elapsed_s(), text[:_LONGEST_SENTENCE]))

    def refresh(self) -> None:
        """Send it the newest facts, if it is time to, and watch its process."""
        if self._client.ended and not self._gone:
            self._gone = True
            self._session.fail(
                f"the {self._name}'s process ended unasked, so the operator sees nothing"
            )
        self._watch_silence()
        now_ns = self._clock.now_ns()
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + EVERY_NS
            self._client.show(self._facts(self._session.state()))

    def close(self) -> None:
        """Close it; may be called twice."""
        self._stack.close()

    def _listen(self, on_event: Callable[[Event], None]) -> None:
        """Hand what the face tells to `on_event` from now on, in a thread of its own."""
        if self._worker is not None:
            self._worker.stop()
        self._worker = worker = Worker(self._name, self._client.body(on_event), self._on_failure)
        self._stack.callback(worker.stop)
        worker.start()

    def _watch_silence(self) -> None:
        """A face that stands still shows old frames, by which the operator must not steer."""
        heard_ns = self._client.heard_ns
        since_ns, patience_ns = (
            (self._opened_ns, OPENING_NS) if heard_ns is None else (heard_ns, SILENT_NS)
        )
        silent = self._clock.now_ns() - since_ns > patience_ns
        if silent and not self._silent:
            if not self._session.config.operator_is_simulated:
                self._session.signals.estop()
            self._session.note(
                "warning",
                f"the {self._name} does not answer, its pictures may be old: do not steer by it",
            )
        self._silent = silent

    def _facts(self, state: SessionState) -> FaceFacts:
        trial = None if self._trial is None else self._trial.facts_of(state)
        replay = None if self._replay is None else self._replay.facts()
        facts = facts_of(state, tuple(self._notices), trial, replay)
        # in a trial its size tells too much
        return replace(facts, recorded_mb=None if self._trial else self._session.recorded_mb)

    def _on_event(self, event: Event) -> None:
        """In a thread of the face's own."""
        if isinstance(event, FaceClosed):
            self._session.fail(
                f"the {self._name} shows nothing any more, so the operator sees nothing: "
                f"{event.why}"
            )

    def _on_failure(self, name: str, failure: BaseException) -> None:
        self._session.fail(f"{name}: {failure!r}")


def facts_of(
    state: SessionState,
    notices: tuple[Notice, ...],
    trial: TrialFacts | None = None,
    replay: ReplayFacts | None = None,
) -> FaceFacts:
    """The state as a face gets it; in a trial without all that reveals what is compared."""
    return FaceFacts(
        state=state if trial is None else without_figures(state),
        advice=what_to_do(state.reason, state.lasting, words_of_hand(state.hand)),
        trial=trial,
        replay=replay,
        notices=notices,
    )
