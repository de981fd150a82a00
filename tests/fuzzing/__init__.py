"""Fuzzing of all that reads bytes of foreign origin."""

from pathlib import Path

CASES = Path(__file__).parent / "cases"  # by target, inputs that were findings
TARGET_NAMES = (
    "configuration",
    "log",
    "messages",
    "operator-end",
    "records",
    "robot-end",
    "sealing",
)
