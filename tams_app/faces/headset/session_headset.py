"""The headset of a session: a face without keys."""

from __future__ import annotations

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


def headset_is_wanted(config: Config) -> bool:
    """True if a headset is to show the views too, where there is a window."""
    show = config.headset.show
    return show == "always" or (show == "auto" and config.hand_is_tracked)


def headset_if_wanted(
    session: FacedSession, trial: ShownTrial | None, replay: ShownReplay | None
) -> SessionFace | None:
    """The headset, unless none is wanted, or for a replay, which may be of another computer."""
    if replay is not None or not headset_is_wanted(session.config):
        return None
    return SessionFace(session, HEADSET, trial, headset=session.config.headset.model_dump())
