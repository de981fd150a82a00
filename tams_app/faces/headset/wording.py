"""The text of the panel below the primary view; pure."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.faces import episodes
from tams_app.faces.banner import Look, banner_of
from tams_app.faces.figures import trial_texts
from tams_app.faces.messages import FaceFacts
from tams_app.teleop.hands import words_of_hand

# A headset hides the keyboard, so the button that confirms comes first.
_KEYS = {
    "disarmed": "{release}, hold {confirm} 1 s (or press Enter) to arm",
    "ready": "Press and hold {deadman} to move it",
    "engaged": "{release} to stop · click {confirm}: emergency stop",
    "holding": "{release} · click {confirm}: emergency stop",
    "fault": "{release}, hold {confirm} 1 s to clear, again to arm",
    "link lost": "{release} and wait for the link",
}


@dataclass(frozen=True, slots=True)
class PanelWords:
    """The panel at one moment."""

    look: Look
    phase: str
    sentence: str
    key: str
    note: str  # a trial's time, the episodes, or the notices last


def panel_words(facts: FaceFacts, hand: str) -> PanelWords:
    """State, phase, why the arm does not move, and what helps; `hand`: of `HANDS`."""
    banner, words = banner_of(facts, hand), words_of_hand(hand)
    confirms = words.confirm and facts.state.arming in _KEYS
    key = words.fill(_KEYS[facts.state.arming]) if confirms else banner.key
    if facts.trial is not None:
        note = " · ".join(trial_texts(facts.trial)[:3])
    elif facts.state.episodes is not None:
        note = episodes.line(facts.state.episodes)
    else:
        note = facts.notices[-1].text if facts.notices else ""
    return PanelWords(banner.look, facts.state.phase, banner.sentence, key, note)
