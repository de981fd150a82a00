"""Why measurements of the hand are refused, each in one sentence that says what to do."""

from __future__ import annotations

from enum import StrEnum

from tams_app.errors import TamsError


class Reason(StrEnum):
    """What is wrong with what was measured."""

    TOO_SHORT = "too short"
    TOO_FEW_SAMPLES = "too few samples"
    CURVED = "curved"
    WENT_BACK = "went back"
    NOISY = "noisy"
    TRACKING = "tracking lost"
    FRAME_CHANGED = "tracking frame changed"
    MISSING = "missing"
    TOO_MANY = "too many"
    NOT_INDEPENDENT = "not independent"
    MIRRORED = "mirrored"
    SKEWED = "skewed"
    CONTRADICTORY = "contradictory"
    TURNED_HAND = "turned hand"
    IMPOSSIBLE_SCALE = "impossible scale"
    UNCERTAIN = "uncertain"
    DRIVEN = "driven"
    NO_BUTTON = "no button"
    TWO_BUTTONS = "two buttons"
    WRONG_BUTTON = "wrong button"
    WRONG_WAY = "wrong way"


class RefusedError(TamsError):
    """The data are no use; `reason` is for programs, the sentence for people."""

    def __init__(self, reason: Reason, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason
