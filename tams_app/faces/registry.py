"""The interface of faces, and the faces by their word for `faces` in the configuration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias, runtime_checkable

from tams_app.config import Config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError
from tams_app.faces.commands import Command
from tams_app.faces.messages import Ended
from tams_app.faces.session_face import FacedSession, ShownReplay, ShownTrial
from tams_app.registry import Registry


class SessionDisplay(Protocol):
    """A face: launched before the session has the processor, opened once it has started."""

    def launch(self) -> None:
        """Start what takes long, such as a process.

        Raises:
            SetupError: it cannot show anything here.
        """

    def open(self) -> None:
        """Begin to show the session.

        A face that the operator steers by adds itself to `FacedSession.displays`.
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


@runtime_checkable
class ShowsEnd(Protocol):
    """A face that also shows what came of a session, and takes an answer; no face has to."""

    answer: Command | None
    """The operator's answer to what was shown last; None: none yet."""

    def end(self) -> None:
        """Show that the session is over; in place of `SessionDisplay.close`, which comes later."""

    def show_end(self, end: Ended) -> None:
        """Show what came of it.

        Args:
            end: all that is to be shown.
        """

    @property
    def is_there(self) -> bool:
        """Whether it can show anything still."""


MakeFace: TypeAlias = Callable[
    [FacedSession, ShownTrial | None, ShownReplay | None], SessionDisplay | None
]
"""Makes a face of the session, of its trial and of its replay, None where it is neither.

In a trial no figures may be shown (`tams_app.records.without_figures`). It returns None if it has
nothing to show of this session.
"""

FACES: Registry[MakeFace] = Registry(
    "faces",
    "tams.faces",
    {
        "window": "tams_app.faces.window.session_window:SessionWindow",
        "headset": "tams_app.faces.headset.session_headset:headset_if_wanted",
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
