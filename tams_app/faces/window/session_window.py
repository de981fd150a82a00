"""The window of a session: a face with keys, and what they do there."""

from __future__ import annotations

from hw.desk.keyboard import DEADMAN, KEYS, HeldKeys
from tams_app.faces.client import WINDOW
from tams_app.faces.commands import actions_of, carry_out
from tams_app.faces.messages import Asked, Event, Keys, Sought
from tams_app.faces.session_face import (
    FacedSession,
    SessionFace,
    ShownReplay,
    ShownTrial,
)

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
        self._actions = actions_of(session, trial.actions) if trial else actions_of(session)

    def _on_event(self, event: Event) -> None:
        if isinstance(event, Asked):
            now_ns = self._clock.now_ns()
            carry_out(self._session, self._actions, event.command, event.t_ns, now_ns)
        elif isinstance(event, Sought):
            if self._replay is not None:
                self._replay.seek(event.t_s)
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
