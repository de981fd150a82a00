"""A display: a file with the states of arming that the session went through."""

from pathlib import Path

from tams_app.config import Config
from tams_app.faces.registry import FacedSession, SessionDisplay, ShownReplay, ShownTrial


class Lamp(SessionDisplay):
    def __init__(
        self, config: Config, folder: Path, trial: ShownTrial | None, replay: ShownReplay | None
    ) -> None:
        self._folder = folder
        self._seen: list[str] = []

    def open(self, session: FacedSession) -> None:
        self._session = session

    def refresh(self) -> None:
        arming = self._session.state().arming
        if self._seen[-1:] != [arming]:
            self._seen.append(arming)

    def close(self) -> None:
        (self._folder / "lamp.txt").write_text("\n".join(self._seen))
