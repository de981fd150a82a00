"""What drives the arm, in the words of the window and the terminal; data."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import Config


@dataclass(frozen=True, slots=True)
class HandWords:
    """One kind of `--hand`.

    deadman: what is held to move. moves: what the READY banner adds about moving. confirm: its
    button that confirms beside Enter, "" if it has none. controls: each with what it does.
    """

    deadman: str
    controls: tuple[tuple[str, str], ...]
    moves: str = ""
    confirm: str = ""


SIMULATED = "sim"
_ONLY_HELD = "deadman: the arm moves only while it is held"
_MODE = "toggle translation and orientation"
_GRIPPER = "close / open the gripper, while {} is held"
_MENU = "held for 1 s: confirm; clicked while the arm is armed: emergency stop"

HANDS = {
    "openvr": HandWords(
        deadman="the trigger",
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
        moves=" with W A S D R F · F1: all keys",
        controls=(
            ("Shift", _ONLY_HELD),
            ("W / S, A / D, R / F", "forward / back, left / right, up / down"),
            ("M", f"{_MODE}: the same keys tilt and turn"),
            ("C / O", _GRIPPER.format("Shift")),
        ),
    ),
    "gamepad": HandWords(
        deadman="the right trigger",
        moves=" with the sticks · F1: all keys",
        confirm="Start",
        controls=(
            ("right trigger", _ONLY_HELD),
            ("left stick", "forward / back, left / right; in orientation mode: tilt"),
            ("right stick", "up / down; in orientation mode, left / right: turn"),
            ("left shoulder", _MODE),
            ("A / B", _GRIPPER.format("the right trigger")),
            ("Start", _MENU),
        ),
    ),
    "spacemouse": HandWords(
        deadman="the left button",
        moves=" with the cap · F1: all keys",
        controls=(
            ("left button", _ONLY_HELD),
            ("cap", "moves the hand; in orientation mode: tilts and turns it"),
            ("right button", _GRIPPER.format("the left button") + ", in turn"),
            ("", f"held for 0.6 s or more: {_MODE}"),
        ),
    ),
    SIMULATED: HandWords(
        deadman="the trigger",
        controls=(("everything else", "the simulated operator does; --hand lets you drive"),),
    ),
}


def hand_of(config: Config) -> str:
    """What drives the arm at this computer, as `HANDS` has it."""
    if config.operator_is_simulated:
        return SIMULATED
    device = config.controller.device
    return "openvr" if device == "auto" else device
