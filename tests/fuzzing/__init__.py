"""Fuzzing of all that reads bytes of foreign origin."""

from pathlib import Path

CASES = Path(__file__).parent / "cases"  # by target, inputs that were findings
TARGET_NAMES = (
    "authentic",
    "channel",
    "configuration",
    "handshake",
    "log",
    "messages",
    "operator-end",
    "records",
    "robot-end",
)
