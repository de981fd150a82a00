"""Words for what drives the arm, in which the operator is told what to do; data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tams_app.config import Config


@dataclass(frozen=True, slots=True)
class HandWords:
    """One kind of `--hand`.

    deadman: what is held to move. controls: each with what it does. moves: what the READY banner
    adds about moving. confirm: its button that confirms beside Enter, "" if it has none.

    The others are parts of sentences. device: what it is. release: the deadman is to be let go.
    wake: what to do while it stands by; connect: while it is not there; check: where its data make
    no sense or do not come.
    """

    deadman: str
    controls: tuple[tuple[str, str], ...]
    device: str
    wake: str
    connect: str
    check: str
    release: str
    moves: str = ""
    confirm: str = ""

    def fill(self, sentence: str) -> str:
        """A sentence with `{deadman}` and the like in it, in these words."""
        text = sentence.format(
            deadman=self.deadman,
            device=self.device,
            release=self.release,
            wake=self.wake,
            connect=self.connect,
            check=self.check,
            confirm=self.confirm,
        )
        return text[:1].upper() + text[1:]


SIMULATED = "sim"
HAND_FACT = "hand"  # in the log: what drives the arm
_ONLY_HELD = "deadman: the arm moves only while it is held"
_MODE = "toggle translation and orientation"
_GRIPPER = "close / open the gripper, while {} is held"
_MENU = "held for 1 s: confirm; clicked while the arm is armed: emergency stop"

HANDS = {
    "openvr": HandWords(
        deadman="the trigger",
        device="the controller",
        wake="put the headset on or wake the controller",
        connect="switch the controller on or plug it in",
        check="check SteamVR and the controller",
        release="release the trigger",
        confirm="the menu button",
        controls=(
            ("trigger", _ONLY_HELD),
            ("grip", _MODE),
            ("A / B", _GRIPPER.format("the trigger")),
            ("menu", _MENU),
        ),
    ),
    "keyboard": HandWords(
        deadman="Shift",
        device="the keyboard",
        wake="click into the window that takes the keys",
        connect="open the window that takes the keys",
        check="check the window that takes the keys",
        release="release Shift",
        moves=" with W A S D R F · F1: all keys",
        controls=(
            ("Shift", _ONLY_HELD),
            ("W / S, A / D, R / F", "forward / back, left / right, up / down"),
            ("M", _MODE),
            ("in orientation mode", "W / S, A / D tilt forward / back, left / right"),
            ("", "R / F turn left / right: seen from above, R anticlockwise, F clockwise"),
            ("C / O", _GRIPPER.format("Shift")),
        ),
    ),
    "gamepad": HandWords(
        deadman="the trigger",
        device="the gamepad",
        wake="click into the page and press a button of the gamepad",
        connect="plug the gamepad in and press one of its buttons",
        check="check the gamepad and the page that reads it",
        release="release the trigger",
        confirm="the menu button",
        controls=(
            ("right trigger", _ONLY_HELD),
            ("left stick", "forward / back, left / right"),
            ("right stick", "up / down"),
            ("left bumper", _MODE),
            ("in orientation mode", "left stick tilts, right stick turns left / right"),
            ("A / B", _GRIPPER.format("the trigger")),
            ("menu", _MENU),
        ),
    ),
    SIMULATED: HandWords(
        deadman="the trigger",
        device="the simulated controller",
        wake="wait for the simulated operator",
        connect="wait for the simulated operator",
        check="see the log of the simulated operator",
        release="let the simulated operator release the trigger",
        controls=(("everything else", "the simulated operator does; --hand lets you drive"),),
    ),
}


def hand_of(config: Config) -> str:
    """The key in `HANDS` of what drives the arm at this computer."""
    if config.operator_is_simulated:
        return SIMULATED
    device = config.controller.device
    return "openvr" if device == "auto" else device


def words_of_hand(hand: str) -> HandWords:
    """The words of `hand`; those of a tracked controller for what is not in `HANDS`."""
    return HANDS.get(hand, HANDS["openvr"])


def words_of(facts: Mapping[str, str]) -> HandWords:
    """The words of what drove the arm in a log with these facts; an older one does not name it."""
    return words_of_hand(facts.get(HAND_FACT, ""))
