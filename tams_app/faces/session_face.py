"""Window and headset of a session: each a process of its own, and what its operator asks for."""

from __future__ import annotations

import threading
from collections import deque
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from hw.desk.keyboard import DEADMAN, KEYS, HeldKeys
from tams_app.config import Config
from tams_app.faces.client import HEADSET, WINDOW, Face, FaceClient
from tams_app.faces.commands import OF_EPISODES, Command
from tams_app.faces.messages import (
    CommandRequest,
    Ended,
    Event,
    FaceClosed,
    FaceFacts,
    Keys,
    Notice,
    Pin,
    ReplayFacts,
    Seek,
    TrialFacts,
)
from tams_app.faces.registry import FacedSession, SessionDisplay, ShownReplay, ShownTrial
from tams_app.records import SessionState, without_figures
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.worker import Worker
from tams_app.teleop.hands import words_of_hand
from tams_app.teleop.reasons import what_to_do
from tams_app.units import NS_PER_S

EVERY_NS = NS_PER_S // 10  # facts for the face
SILENT_NS = 2 * NS_PER_S  # of a face that reports 50 times a second
OPENING_NS = 10 * NS_PER_S  # until it reports the first time
_NOTICES, _LONGEST_SENTENCE = 3, 500
_ENDING = Ended("The session is over", ("What was recorded is being written …",))
_NOT_BEFORE_NS = NS_PER_S  # a key that was meant for the session ends nothing
_HAND_KEYS = {"Shift_L": DEADMAN, "Shift_R": DEADMAN}


def carry_out(
    session: FacedSession, trial: ShownTrial | None, command: Command, asked_ns: int
) -> None:
    """Carry out a command, in any thread; one of a trial changes nothing elsewhere.

    `asked_ns` is when the operator gave it at the earliest, however long it waited for an
    application that stood still.
    """
    if command is Command.CONFIRM:
        session.signals.confirm(asked_ns)
    elif command is Command.EMERGENCY_STOP:
        session.signals.estop()
    elif command is Command.QUIT:
        session.end("ended by the operator")
    elif command is Command.CLOSE:
        session.end("the operator closed the window")
    elif command in OF_EPISODES:
        session.signals.episode(OF_EPISODES[command])
    elif trial is not None:
        trial.mark(command)


class SessionFace(SessionDisplay):
    """Launched and opened, it follows the session until it is closed; `refresh` it often.

    What the operator steers by must be alive: where its process ends, or shows nothing any more,
    the session fails; where it stands still, its pictures count as old, and a person's arm gets
    an emergency stop.
    """

    def __init__(
        self,
        folder: Path,
        face: Face,
        trial: ShownTrial | None = None,
        replay: ShownReplay | None = None,
        **specification: Any,
    ) -> None:
        """`folder`: of the session. `specification`: what its process is started with, besides its
        socket.
        """
        self._folder, self._trial, self._replay = folder, trial, replay
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
        logs = self._folder / "helpers"
        logs.mkdir(exist_ok=True)
        self._client.launch(logs, **self._specification)
        self._stack.callback(self._client.close)

    def open(self, session: FacedSession) -> None:
        """Show the session."""
        self._session = session
        replay = self._replay
        blind = self._trial is not None or (replay is not None and replay.blind)
        outline = None if replay is None else replay.outline
        self._client.open(session.config, session.screen, blind, outline, session.mount)
        self._opened_ns = self._clock.now_ns()
        if not session.config.operator_is_simulated:
            session.displays.add(self._seen_ns)
        self._listen()

    def notify(self, note: str) -> None:
        """A sentence for the operator."""
        self._notices.append(Notice(self._session.elapsed_s(), note[:_LONGEST_SENTENCE]))

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

    def _seen_ns(self, view: str) -> int:
        return self._client.seen_ns.get(view, self._opened_ns)

    def _listen(self) -> None:
        """Take in what the face reports from now on, in a thread of its own."""
        if self._worker is not None:
            self._worker.stop()
        self._worker = worker = Worker(self._name, self._take_in, self._on_failure)
        self._stack.callback(worker.stop)
        worker.start()

    def _take_in(self, stop: threading.Event) -> None:
        for event in self._client.events(stop):
            self._on_event(event)

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


class SessionWindow(SessionFace):
    """The operator's window: a face with keys, which also shows what came of the session."""

    def __init__(
        self,
        _config: Config,
        folder: Path,
        trial: ShownTrial | None = None,
        replay: ShownReplay | None = None,
    ) -> None:
        super().__init__(folder, WINDOW, trial, replay)
        self._last: SessionState | None = None  # of a session that is over
        self._counts_ns = 0
        self._is_closed = False

    def end(self) -> None:
        """The session is over: nothing that is asked counts for it any more.

        The window stays, with its last pictures, and shows that all is written; but for one that
        the operator has closed.
        """
        if self._is_closed:
            self.close()
            return
        state = self._session.state()
        self._last = replace(state, arming="", reason="", deadman=None, pressed=(), placed=False)
        self._listen()  # what was asked before is done by then
        self.show_end(_ENDING)

    def show_end(self, end: Ended) -> None:
        """What came of the session; what is answered counts from a moment after."""
        assert self._last is not None, "it is over"
        self.answer = None
        self._counts_ns = self._clock.now_ns() + _NOT_BEFORE_NS
        self._client.show(replace(self._facts(self._last), end=end))

    @property
    def is_there(self) -> bool:
        """True while its process lives, and the operator has not closed it."""
        return not (self._client.ended or self._is_closed)

    def _on_event(self, event: Event) -> None:
        if self._last is not None:
            if isinstance(event, CommandRequest) and event.t_ns >= self._counts_ns:
                self.answer = event.command
        elif isinstance(event, CommandRequest):
            self._is_closed |= event.command is Command.CLOSE
            carry_out(self._session, self._trial, event.command, event.t_ns)
        elif isinstance(event, Seek):
            if self._replay is not None:
                self._replay.seek(event.t_s)
        elif isinstance(event, Pin):
            if self._trial is None:  # what a study compares is decided by the strategy alone
                self._session.signals.pinned = event.view
        elif isinstance(event, Keys):
            if self._replay is not None:
                self._replay.on_keys(event)
            if self._session.keyboard is not None:
                self._session.keyboard.feed(_held_keys(event))
        else:
            super()._on_event(event)


def _held_keys(event: Keys) -> HeldKeys:
    """The keys that are down, for a hand that they move."""
    names = {_HAND_KEYS.get(name, name) for name in event.held}
    return HeldKeys(KEYS & names, event.focused, event.t_ns, event.presses)


def headset_is_wanted(config: Config) -> bool:
    """True if a headset is to show the views too, where there is a window."""
    show = config.headset.show
    return show == "always" or (show == "auto" and config.hand_is_tracked)


def headset_if_wanted(
    config: Config, folder: Path, trial: ShownTrial | None, replay: ShownReplay | None
) -> SessionFace | None:
    """The headset, unless none is wanted, or for a replay, which may be of another computer."""
    if replay is not None or not headset_is_wanted(config):
        return None
    return SessionFace(folder, HEADSET, trial, headset=config.headset.model_dump())
