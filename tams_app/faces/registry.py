"""What shows a session to the operator: the words of `faces` in the configuration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.faces.session_face import FacedSession, ShownReplay, ShownTrial
from tams_app.registry import Registry


class Shown(Protocol):
    """A face: launched before the session has the processor, opened once it has started."""

    def launch(self) -> None:
        """Start what takes long.

        Raises:
            SetupError: it cannot show anything here.
        """

    def open(self) -> None:
        """Begin to show the session; what the operator steers by enters `displays`."""

    def say(self, note: str) -> None:
        """Show a sentence."""

    def refresh(self) -> None:
        """Show what is new; called some 20 times a second in the main thread."""

    def close(self) -> None:
        """Show nothing more; may be called twice."""


MakeFace = Callable[[FacedSession, ShownTrial | None, ShownReplay | None], Shown | None]
"""None: it has nothing to show of this session. In a trial no figures may be shown."""

FACES: Registry[MakeFace] = Registry(
    "faces",
    "tams.faces",
    {
        "window": "tams_app.faces.window.session_window:SessionWindow",
        "headset": "tams_app.faces.headset.session_headset:headset_if_wanted",
    },
)


def check_faces(config: Config) -> None:
    """ConfigError if one of the configured faces does not exist, or one that is needed is not."""
    for name in config.faces:
        _ = FACES[name]
    if len(set(config.faces)) < len(config.faces):
        raise ConfigError(f"faces: {', '.join(config.faces)}: each may be named once only")
    if config.controller.device == "keyboard" and "window" not in config.faces:
        raise ConfigError("faces: controller.device keyboard needs the window")
