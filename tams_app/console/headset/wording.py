"""What the panel below the primary view says; pure."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.console.window.banner import Look, banner_of
from tams_app.console.window.figures import trial_texts
from tams_app.console.window.messages import Facts

# A headset hides the keyboard, so the controller's menu button comes first.
_KEYS = {
    "disarmed": "Release the trigger, hold the menu button 1 s (or press Enter) to arm",
    "engaged": "Release the trigger to stop · click the menu button: emergency stop",
    "holding": "Release the trigger · click the menu button: emergency stop",
    "fault": "Release the trigger, hold the menu button 1 s to clear, again to arm",
    "link lost": "Wait for the link, release the trigger, hold the menu button 1 s",
}


@dataclass(frozen=True, slots=True)
class PanelWords:
    """The panel at one moment."""

    look: Look
    phase: str
    sentence: str
    key: str
    note: str  # a trial's time, or what was said last


def panel_words(facts: Facts) -> PanelWords:
    """State, phase, why the arm does not move, and what helps."""
    banner = banner_of(facts)
    key = _KEYS.get(facts.arming, banner.key)
    if facts.trial is not None:
        note = " · ".join(trial_texts(facts.trial)[:3])
    else:
        note = facts.said[-1].text if facts.said else ""
    return PanelWords(banner.look, facts.phase, banner.sentence, key, note)
