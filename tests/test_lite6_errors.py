"""The controller's errors in words."""

from __future__ import annotations

import pytest

from tams_app.lite6_errors import CONTROLLER_ERRORS, describe_arm_error

pytestmark = pytest.mark.untimed


def test_an_error_is_told_with_its_number_its_meaning_and_its_own_advice() -> None:
    told = describe_arm_error(24)
    assert told == "C24 (joint too fast): keep away from stretched and folded wrist poses"


def test_an_unknown_error_still_says_where_to_look() -> None:
    assert describe_arm_error(97) == "C97: look it up in UFACTORY's user manual"


@pytest.mark.parametrize("code", CONTROLLER_ERRORS)
def test_meaning_and_remedy_fit_into_a_line_of_the_terminal(code: int) -> None:
    told = describe_arm_error(code)
    assert len(told) <= 90
    assert not told.endswith(".")
