"""What the banner says in each state of the arming table; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from tams_app import palette
from tams_app.console.hands import HANDS, SIMULATED
from tams_app.console.window.messages import Facts


@dataclass(frozen=True, slots=True)
class Look:
    """How a state is told: word and sign, border and colour; no two states share any of them.

    border: as CSS has it. colour: of border and banner; ink: of what is written on it.
    """

    word: str
    sign: str
    border: str
    colour: str
    ink: str


@dataclass(frozen=True, slots=True)
class Banner:
    """The banner of one moment."""

    look: Look
    sentence: str
    key: str  # what helps
    button: str = "STOP"  # what a click on it does


_DARK, _LIGHT = "#101418", "#FFFFFF"
LOOKS = {
    "disarmed": Look("DISARMED", "○", "groove", "#8A939C", _DARK),
    "ready": Look("READY", "◉", "ridge", palette.SKY, _DARK),
    "engaged": Look("ENGAGED", "▶", "solid", "#1B8A3A", _LIGHT),
    "holding": Look("HOLDING", "❚❚", "dashed", palette.YELLOW, _DARK),
    "fault": Look("FAULT", "✖", "double", "#C73E00", _LIGHT),
    "link lost": Look("LINK LOST", "⚠", "dotted", palette.PURPLE, _DARK),
}
_OTHER = Look("STARTING", "…", "inset", "#4A525A", _LIGHT)

_QUIET = {  # sentence and what helps, where nothing is wrong
    "disarmed": ("The arm does not move.", "Release the trigger, then press Enter to arm it"),
    "ready": ("The arm waits.", "Press and hold the trigger to move it"),
    "engaged": (
        "The arm follows your hand.",
        "Release the trigger to stop · Space: emergency stop",
    ),
    "link lost": (
        "Nothing is heard of the robot, which stops by itself.",
        "Wait until the link is back, release the trigger, then Enter",
    ),
}
_STARTING = ("The session starts.", "F1 lists all keys")


def look_of(arming: str) -> Look:
    """How a state looks; what is no state is a start."""
    return LOOKS.get(arming, _OTHER)


_SIMULATED_KEYS = {  # by state, and whether something has stopped the arm before
    ("fault", True): "Enter: first clears, then arms",
    ("disarmed", True): "Enter arms it: the simulated operator does so only once",
    ("holding", True): "The simulated operator goes on · Space: emergency stop",
}
_SIMULATED = {  # who watches can do that much
    "disarmed": ("The arm does not move.", "The simulated operator arms it soon"),
    "ready": ("The arm waits.", "The simulated operator moves it · Space: emergency stop"),
    "engaged": (
        "The simulated operator drives.",
        "Space: emergency stop · to drive yourself: --hand keyboard",
    ),
}


def banner_of(facts: Facts, hand: str = "openvr") -> Banner:
    """The state, why the arm does not move, and the key that helps; of a replay that it is one.

    hand: what drives the arm, of `HANDS`.
    """
    if facts.replay is not None:
        banner = _banner_of(facts, _QUIET)
        return replace(
            banner,
            look=replace(banner.look, word=f"REPLAY: {banner.look.word}"),
            key="Nothing moves · F1: keys",
            button="PLAY" if facts.replay.paused else "PAUSE",
        )
    if hand == SIMULATED:
        banner = _banner_of(facts, _QUIET | _SIMULATED)
        key = _SIMULATED_KEYS.get((facts.arming, bool(facts.reason)), banner.key)
        return replace(banner, key=key)
    banner, words = _banner_of(facts, _QUIET), HANDS[hand]

    def in_words(text: str) -> str:
        return text.replace("the trigger", words.deadman)

    moves = words.moves if facts.arming == "ready" else ""
    return Banner(banner.look, in_words(banner.sentence), in_words(banner.key) + moves)


def _banner_of(facts: Facts, quiet: Mapping[str, tuple[str, str]]) -> Banner:
    look = look_of(facts.arming)
    if facts.arming == "holding":
        return Banner(look, _told(facts), "Release the trigger · Space: emergency stop")
    if facts.arming == "fault":
        return Banner(
            look, _told(facts), "Enter, with the trigger released: first clears, then arms"
        )
    sentence, key = quiet.get(facts.arming, _STARTING)
    if facts.reason and facts.arming in ("ready", "engaged", "disarmed"):
        sentence = f"{sentence} Last stop: {facts.reason}."
    return Banner(look, sentence, key)


def _told(facts: Facts) -> str:
    reason = facts.reason[:1].upper() + facts.reason[1:]
    if reason and not reason.endswith("."):
        reason += "."
    return f"{reason} {facts.advice}".strip() or "The arm has stopped."
