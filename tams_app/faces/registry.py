"""The interface of faces, and the faces by their word for `faces` in the configuration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from tams_app.config import Config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError
from tams_app.faces.commands import Command, OperatorSignals
from tams_app.faces.messages import Ended, Keys, Outline, ReplayFacts, TrialFacts
from tams_app.records import SessionState
from tams_app.registry import Registry
from tams_app.station.fresh_video import Displays
from tams_app.video.live.frame_ring import FrameBlock

if TYPE_CHECKING:
    from hw.desk.keyboard import KeyboardController
    from tams_app.station.mount_memory import MountMemory


class FacedSession(Protocol):
    """The session as a face sees it."""

    config: Config
    """Its whole configuration."""
    folder: Path
    """Its folder in the logs, which exists."""

    @property
    def signals(self) -> OperatorSignals:
        """The operator's signals; from any thread."""

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

    def end(self, reason: str) -> None:
        """End the session.

        Args:
            reason: a clause for the log.
        """

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

    def mark(self, command: Command) -> None:
        """Carry out a command that exists in a trial only; from any thread.

        Args:
            command: `DROP`, `NO_DROP` or `PLACED`.
        """

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


class SessionDisplay:
    """A face: launched before the session has the processor, opened once it has started.

    It has no need to show what came of a session; one that does overrides the last three as well.
    """

    answer: Command | None = None
    """The operator's answer to what was shown of the end last; None: none yet."""

    def launch(self) -> None:
        """Start what takes long, such as a process.

        Raises:
            SetupError: it cannot show anything here.
        """

    def open(self, session: FacedSession) -> None:
        """Begin to show the session; a face that is steered by adds itself to its displays.

        Args:
            session: open, until the face is closed.
        """

    def notify(self, note: str) -> None:
        """Show a sentence.

        Args:
            note: one line for the operator.
        """

    def refresh(self) -> None:
        """Show what is new; called some 20 times a second in the main thread."""

    def close(self) -> None:
        """Show nothing more; may be called twice."""

    def end(self) -> None:
        """Show that the session is over; one that shows no end closes, others do so later."""
        self.close()

    def show_end(self, end: Ended) -> None:
        """Show what came of it.

        Args:
            end: all that is to be shown.
        """

    @property
    def is_there(self) -> bool:
        """Whether it can still show what came of the session."""
        return False


MakeFace: TypeAlias = Callable[
    [Config, Path, ShownTrial | None, ShownReplay | None], SessionDisplay | None
]
"""Makes a face of a session, before that is open: of its whole configuration, of its folder in the
logs, which exists, of its trial and of its replay, None where it is neither.

In a trial no figures may be shown (`tams_app.records.without_figures`). It returns None if it has
nothing to show of this session.
"""

FACES: Registry[MakeFace] = Registry(
    "faces",
    "tams.faces",
    {
        "window": "tams_app.faces.session_face:SessionWindow",
        "headset": "tams_app.faces.session_face:headset_if_wanted",
    },
)
"""Makers of a face by their word for `faces`; entry points of `tams.faces`."""


def check_faces(config: Config) -> None:
    """Check that the configured faces exist, and those that are needed are among them.

    Args:
        config: the whole configuration.

    Raises:
        ConfigError: one does not exist, is named twice, or is missing.
    """
    for name in config.faces:
        if name == "sounds" and name not in FACES:
            raise ConfigError(f"faces: sounds: {REMOVED[name]}")
        _ = FACES[name]
    if len(set(config.faces)) < len(config.faces):
        raise ConfigError(f"faces: {', '.join(config.faces)}: each may be named once only")
    if config.controller.device == "keyboard" and "window" not in config.faces:
        raise ConfigError("faces: controller.device keyboard needs the window")
