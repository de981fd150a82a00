"""What does not depend on one make of arm names none, and logs of older versions stay readable."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tams_app.recording.codec import Codec
from tams_app.records import Activity, ArmFault, ArmState, ServoMode

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
PACKAGES = ("teleop", "policy", "recording", "summary")
VENDOR_WORDS = ("lite6", "lite 6", "xarm", "uxbus", "ufactory")
CODEC = Codec(ArmState)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_make_of_arm_is_named(package: str) -> None:
    modules = sorted((ROOT / "tams_app" / package).rglob("*.py"))
    assert modules
    for path in modules:
        text = path.read_text(encoding="utf-8").lower()
        assert not [word for word in VENDOR_WORDS if word in text], path


@pytest.mark.parametrize(
    ("mode", "state", "error_code", "meaning"),
    [
        (5, 1, 0, (ServoMode.VELOCITY, Activity.MOVING, None)),
        (1, 2, 0, (ServoMode.POSE, Activity.IDLE, None)),
        (0, 3, 0, (None, Activity.PAUSED, None)),
        (5, 4, 31, (ServoMode.VELOCITY, Activity.STOPPED, ArmFault(31, "C31"))),
        (5, 5, 0, (ServoMode.VELOCITY, Activity.STOPPED, None)),
    ],
)
def test_an_arm_state_with_the_numbers_of_older_logs_is_read_in_todays_words(
    mode: int, state: int, error_code: int, meaning: tuple[object, ...]
) -> None:
    logged = {
        "received_ns": 7,
        "joints": [0.0] * 6,
        "tcp": {"position": [0.3, 0.0, 0.2], "rotation": [0.0, 0.0, 0.0, 1.0]},
        "mode": mode,
        "state": state,
        "error_code": error_code,
        "warning_code": 11,
        "gripper_closed": False,
    }
    read = CODEC.decode(json.dumps(logged).encode())
    assert (read.servo, read.activity, read.fault) == meaning
    assert (read.warning_code, read.gripper_closed) == (11, False)
