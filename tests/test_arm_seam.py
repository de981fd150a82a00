"""What does not depend on one make of arm names none."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
PACKAGES = ("teleop", "policy", "recording", "summary")
VENDOR_WORDS = ("lite6", "lite 6", "xarm", "uxbus", "ufactory")


@pytest.mark.parametrize("package", PACKAGES)
def test_no_make_of_arm_is_named(package: str) -> None:
    modules = sorted((ROOT / "tams_app" / package).rglob("*.py"))
    assert modules
    for path in modules:
        text = path.read_text(encoding="utf-8").lower()
        assert not [word for word in VENDOR_WORDS if word in text], path
