"""The sounds of a session as a face, which neither needs a display nor holds anything up."""

from __future__ import annotations

import threading
from contextlib import ExitStack

from tams_app.errors import HelperError
from tams_app.faces.session_face import FacedSession, ShownReplay, ShownTrial
from tams_app.faces.sounds.tones import ToneChoice
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.worker import Worker

DEVICE = "autoaudiosink"
_WITHOUT = "the session goes on without sounds"


class SessionSounds:
    """Satisfies `tams_app.faces.registry.Shown`; without a device for sound the session goes on."""

    def __init__(self, session: FacedSession, sink: str = DEVICE) -> None:
        """`sink`: where the tones go, as GStreamer's launch syntax has it."""
        self._session = session
        logs = session.folder / "helpers"
        logs.mkdir(exist_ok=True)
        self._process = HelperProcess(
            "sounds", "tams_app.faces.sounds.process", {"sink": sink}, logs
        )
        self._worker = Worker("sounds", self._await_ready)
        self._choice, self._number = ToneChoice(), 0
        self._plays = False
        self._stack = ExitStack()

    def launch(self) -> None:
        """Start its process."""
        self._stack.callback(self._process.stop)
        self._process.start()

    def open(self) -> None:
        """Learn in a thread whether there is sound."""
        self._stack.callback(self._worker.stop)
        self._stack.callback(self._process.stop)  # which that thread may wait for
        self._stack.callback(self._worker.request_stop)
        self._worker.start()

    def notify(self, note: str) -> None:
        """Nothing: sentences are to be read."""

    def refresh(self) -> None:
        """Have a tone played if the arming state has changed to one that has a tone.

        Its process is watched as well: unlike that of a face which shows the video, it may end.
        """
        if self._plays and self._process.exit_code is not None:
            self._plays = False
            self._session.note("warning", f"the sounds' process ended unasked; {_WITHOUT}")
        tone = self._choice.step(self._session.state().arming)
        if tone is not None:
            self._number += 1
            self._process.send(tone=tone, number=self._number)

    def close(self) -> None:
        """Play nothing more; may be called twice."""
        self._stack.close()

    def _await_ready(self, stop: threading.Event) -> None:
        try:
            self._process.wait_ready()
            self._plays = True
        except HelperError as error:
            if not stop.is_set():
                self._session.note("warning", f"{error}; {_WITHOUT}")


def sounds_of(
    session: FacedSession, _trial: ShownTrial | None, replay: ShownReplay | None
) -> SessionSounds | None:
    """The sounds of a session; a replay has none."""
    return SessionSounds(session) if replay is None else None
