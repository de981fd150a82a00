"""What the operator does about a stop, from the words in which it is told."""

from __future__ import annotations

from tams_app.teleop.reasons import Reason

_REASONS = {reason.label: reason for reason in Reason}


def advice(told: str) -> str:
    """What happened, as it is told, and what to do."""
    return f"{told}{'' if told.endswith('.') else '.'} {what_to_do(told)}".strip()


def what_to_do(told: str) -> str:
    """For a reason's label and its detail (`session.control.describe`); "" for no reason.

    A detail that is a sentence says by itself what to do, but perhaps not how to go on.
    """
    label, _, detail = told.partition(": ")
    reason = _REASONS.get(label)
    if reason is None:
        return ""
    if not detail.endswith("."):
        return reason.sentence
    return "" if "confirm" in told else "Release the trigger, then confirm."
