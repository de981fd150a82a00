"""The headset of a session: a face without keys."""

from __future__ import annotations

from typing import Any

from tams_app.config import Config
from tams_app.faces.client import Face
from tams_app.faces.session_face import (
    FacedSession,
    SessionFace,
    ShownReplay,
    ShownTrial,
)

HEADSET = Face(
    "headset",
    "tams_app.faces.headset.process",
    "set headset.show to never to go without the views in the headset",
)


class SessionHeadset(SessionFace):
    """The views in the operator's headset."""

    def __init__(self, session: FacedSession, trial: ShownTrial | None = None) -> None:
        super().__init__(session, HEADSET, trial)

    def _specification(self) -> dict[str, Any]:
        return {"headset": self._session.config.headset.model_dump()}


def headset_is_wanted(config: Config) -> bool:
    """True if a headset is to show the views too, where there is a window."""
    show = config.headset.show
    return show == "always" or (show == "auto" and config.hand_is_tracked)


def headset_if_wanted(
    session: FacedSession, trial: ShownTrial | None, replay: ShownReplay | None
) -> SessionHeadset | None:
    """The headset, unless none is wanted, or for a replay, which may be of another computer."""
    wanted = replay is None and headset_is_wanted(session.config)
    return SessionHeadset(session, trial) if wanted else None
