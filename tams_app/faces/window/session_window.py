"""The window of a session: a face with keys, and what they do there."""

from __future__ import annotations

from msgspec.structs import replace

from hw.desk.keyboard import DEADMAN, KEYS, HeldKeys
from tams_app.faces.client import WINDOW
from tams_app.faces.commands import Command, actions_of, carry_out
from tams_app.faces.messages import CommandRequest, Ended, Event, Keys, Pin, Seek
from tams_app.faces.session_face import (
    FacedSession,
    SessionFace,
    ShownReplay,
    ShownTrial,
)
from tams_app.records import SessionState
from tams_app.units import NS_PER_S

_ENDING = ("The session is over", ("What was recorded is being written …",))
_NOT_BEFORE_NS = NS_PER_S  # a key that was meant for the session ends nothing

_HAND_KEYS = {"Shift_L": DEADMAN, "Shift_R": DEADMAN}


class SessionWindow(SessionFace):
    """The operator's window."""

    def __init__(
        self,
        session: FacedSession,
        trial: ShownTrial | None = None,
        replay: ShownReplay | None = None,
    ) -> None:
        super().__init__(session, WINDOW, trial, replay)
        self._last = SessionState(t_s=0.0, arming="")
        self._counts_ns = 0
        self._is_closed = False
        self.answer: Command | None = None  # of the operator, once the session is over
        self._actions = actions_of(session, trial.actions) if trial else actions_of(session)

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
        self._listen(self._on_answer)
        self.show_end(Ended(*_ENDING))

    def show_end(self, end: Ended) -> None:
        """What came of the session; what is answered counts from a moment after."""
        self.answer = None
        self._counts_ns = self._clock.now_ns() + _NOT_BEFORE_NS
        self._client.show(replace(self._facts(self._last), end=end))

    @property
    def is_there(self) -> bool:
        """True while its process lives, and the operator has not closed it."""
        return not (self._client.ended or self._is_closed)

    def _on_answer(self, event: Event) -> None:
        if isinstance(event, CommandRequest) and event.t_ns >= self._counts_ns:
            self.answer = event.command

    def _on_event(self, event: Event) -> None:
        if isinstance(event, CommandRequest):
            self._is_closed |= event.command is Command.CLOSE
            carry_out(self._session, self._actions, event.command, event.t_ns)
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
                self._session.keyboard.feed(held_keys(event))
        else:
            super()._on_event(event)


def held_keys(event: Keys) -> HeldKeys:
    """The keys that are down, for a hand that they move."""
    names = {_HAND_KEYS.get(name, name) for name in event.held}
    return HeldKeys(KEYS & names, event.focused, event.t_ns, event.presses)
