"""A process with a played session and its real window, for a test that stops it.

Its folder is the only argument.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from rich.console import Console

from tams_app.console import app
from tams_app.records import SessionState
from tests.faces.played_session import PlayedSession


class EngagedSession(PlayedSession):
    """The arm follows, the deadman is held, and all views have a picture."""

    def state(self) -> SessionState:
        return replace(super().state(), arming="engaged", reason="", lasting="", last_stop="")

    def poll(self) -> None:
        super().poll()
        video = self.config.video
        for number, view in enumerate(video.views):
            image = np.full((video.height, video.width, 3), (60, 90, 200), np.uint8)
            image[:, : 80 * (number + 1)] = (200, 120, 40)
            self.screen.put(view, 1, 1, image)


def main() -> None:
    app.show_session(EngagedSession(Path(sys.argv[1])), Console(quiet=True))


if __name__ == "__main__":
    main()
