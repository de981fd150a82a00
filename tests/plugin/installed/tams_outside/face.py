"""A display: a file with the states of arming that the session went through."""

from tams_app.faces.registry import FacedSession, SessionDisplay, ShownReplay, ShownTrial


class Lamp(SessionDisplay):
    def __init__(
        self, session: FacedSession, trial: ShownTrial | None, replay: ShownReplay | None
    ) -> None:
        self._session = session
        self._seen: list[str] = []

    def refresh(self) -> None:
        arming = self._session.state().arming
        if self._seen[-1:] != [arming]:
            self._seen.append(arming)

    def close(self) -> None:
        (self._session.folder / "lamp.txt").write_text("\n".join(self._seen))
