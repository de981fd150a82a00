"""The banner's words in each state of the arming table; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import msgspec

from tams_app import palette
from tams_app.faces.messages import FaceFacts
from tams_app.faces.silence import NOT_LIVE, NOT_RECEIVED, STILL_STOPS, not_received
from tams_app.teleop.hands import SIMULATED, HandWords, words_of_hand


@dataclass(frozen=True, slots=True)
class Look:
    """The appearance of a state: word and sign, border and colour; no two states share any of them.

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
    NOT_LIVE: Look("NOT LIVE", "□", "outset", "#C3C7CB", _DARK),
}
OTHER = Look("STARTING", "…", "inset", "#4A525A", _LIGHT)

ENDED = replace(OTHER, word="ENDED", sign="■")

QUIET = {  # sentence and what helps, where nothing is wrong, as `HandWords.fill` takes them
    "disarmed": ("The arm does not move.", "{release}, then press Enter to arm"),
    "ready": ("The arm waits.", "Press and hold {deadman} to move it"),
    "engaged": (
        "The arm follows your hand.",
        "{release} to stop · Space: emergency stop",
    ),
    "link lost": (
        "The robot stops by itself.",
        "{release} and wait until the link is back",
    ),
}
_REPLAY = {  # what was, without what helps
    "disarmed": ("The arm did not move.", ""),
    "ready": ("The arm waited.", ""),
    "engaged": ("The arm followed the operator's hand.", ""),
    "link lost": ("The robot stopped by itself.", ""),
}
STARTING = ("The session starts.", "F1 lists all keys")
PHRASES = {  # beside those of the states
    "shift is dead": "Shift does not count yet: let go and press again",
    "press again": "{release}, then press and hold {deadman} again",
    "arm": "Press Enter to arm",
    "holding": "{release} · Space: emergency stop",
    "fault": "Enter, with {deadman} released: first clears, then arms",
    "last stop": "Last stop: {stop}.",
    "stopped": "The arm has stopped.",
    "still stops": STILL_STOPS,
    "not received": NOT_RECEIVED,
    "not live": "{still_stops} still stops it",
}


def look_of(arming: str) -> Look:
    """The appearance of a state; what is no state is a start."""
    return LOOKS.get(arming, OTHER)


SIMULATED_KEYS = {  # by state, and whether something has stopped the arm before
    ("fault", True): "Enter: first clears, then arms",
    ("disarmed", True): "Enter arms it: the simulated operator does so only once",
    ("holding", True): "The simulated operator goes on · Space: emergency stop",
}
SIMULATED_QUIET = {  # who watches can do that much
    "disarmed": ("The arm does not move.", "The simulated operator arms it soon"),
    "ready": ("The arm waits.", "The simulated operator moves it · Space: emergency stop"),
    "engaged": (
        "The simulated operator drives.",
        "Space: emergency stop · to drive yourself: --hand keyboard",
    ),
    "link lost": (QUIET["link lost"][0], "Wait until the link is back"),
}


def banner_of(facts: FaceFacts, hand: str = "openvr", shift_is_dead: bool = False) -> Banner:
    """The state, why the arm does not move, and the key that helps; of a replay that it is one.

    Of a session that is over, what came of it.

    hand: what drives the arm, of `HANDS`. shift_is_dead: `Keyboard.shift_is_dead`.
    """
    words, state = words_of_hand(hand), facts.state
    if facts.end is not None:
        return Banner(ENDED, facts.end.headline, facts.end.key, "CLOSE")
    if state.arming == NOT_LIVE and facts.silent_s is not None:
        key = PHRASES["not live"].format(still_stops=STILL_STOPS)
        return Banner(look_of(NOT_LIVE), not_received(facts.silent_s), key)
    if facts.replay is not None:
        banner = _banner_of(msgspec.structs.replace(facts, advice=""), _REPLAY, words)
        return replace(
            banner,
            look=replace(banner.look, word=f"REPLAY: {banner.look.word}"),
            key="Nothing moves · F1: keys",
            button="PLAY" if facts.replay.paused else "PAUSE",
        )
    if hand == SIMULATED:
        banner = _banner_of(facts, QUIET | SIMULATED_QUIET, words)
        has_stopped = bool(state.reason or state.last_stop)
        return replace(banner, key=SIMULATED_KEYS.get((state.arming, has_stopped), banner.key))
    banner = _banner_of(facts, QUIET, words)
    if shift_is_dead and hand == "keyboard" and state.arming == "ready":
        return replace(banner, key=PHRASES["shift is dead"])
    if state.arming == "disarmed" and state.deadman is False:
        return replace(banner, key=PHRASES["arm"])
    if state.arming == "ready" and state.deadman:  # pressed while something was in the way
        return replace(banner, key=words.fill(PHRASES["press again"]))
    moves = words.moves if state.arming == "ready" else ""
    return replace(banner, key=banner.key + moves)


def _banner_of(facts: FaceFacts, quiet: Mapping[str, tuple[str, str]], words: HandWords) -> Banner:
    state = facts.state
    look = look_of(state.arming)
    if state.arming == "holding":
        return Banner(look, _sentence(facts), words.fill(PHRASES["holding"]))
    if state.arming == "fault":
        key = words.fill(PHRASES["fault"])
        return Banner(look, _sentence(facts), key)
    sentence, key = map(words.fill, quiet.get(state.arming, STARTING))
    if state.arming in ("ready", "engaged", "disarmed"):
        if state.reason:  # nothing has stopped: it is in the way of going on
            sentence = f"{sentence} {_sentence(facts)}"
        elif state.last_stop:
            sentence = f"{sentence} {PHRASES['last stop'].format(stop=state.last_stop)}"
    elif facts.silent_s is not None:
        stops = PHRASES["not live"].format(still_stops=STILL_STOPS)
        sentence = f"{sentence} {not_received(facts.silent_s)} {stops}."
    return Banner(look, sentence, key)


def _sentence(facts: FaceFacts) -> str:
    reason = facts.state.reason
    reason = reason[:1].upper() + reason[1:]
    if reason and not reason.endswith("."):
        reason += "."
    return f"{reason} {facts.advice}".strip() or PHRASES["stopped"]
