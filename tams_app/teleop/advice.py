"""What the operator does about a stop, from the words in which it is recorded."""

from __future__ import annotations

from tams_app.teleop.hands import HandWords
from tams_app.teleop.reasons import Reason

_REASONS = {reason.label: reason for reason in Reason}
_GO_ON = "{release}, then confirm."


def advice(held: str, lasting: str | None, hand: HandWords) -> str:
    """What happened, as it is recorded, and what to do."""
    return f"{held}{'' if held.endswith('.') else '.'} {what_to_do(held, lasting, hand)}".strip()


def what_to_do(held: str, lasting: str | None, hand: HandWords) -> str:
    """For a reason's label and its detail (`robot.control.describe`); "" for no reason.

    `lasting`: label of the reason whose cause is still there, the same or one that came besides;
    "": it is gone; None: not known, as in a log of an older version. A detail that is a sentence
    says by itself what to do, but perhaps not how to go on.
    """
    label, _, detail = held.partition(": ")
    reason = _REASONS.get(label)
    if reason is None:
        return ""
    besides = _REASONS.get(lasting or "", reason)
    if besides is not reason:
        return besides.sentence(hand)
    if lasting == "":
        return reason.sentence(hand, lasts=False)
    if not detail.endswith("."):
        return reason.sentence(hand)
    return "" if "confirm" in held else hand.fill(_GO_ON)


def refusal(in_the_way: Reason | None, hand: HandWords) -> str:
    """Why a confirmation does not count; None: but for the deadman nothing is in its way."""
    if in_the_way is None:
        return f"{hand.release} first."
    return f"{in_the_way.label}. {in_the_way.sentence(hand)}"
