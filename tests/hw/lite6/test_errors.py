"""The controller's errors in words."""

from __future__ import annotations

import pytest

from hw.lite6.commands import CONTROLLER_ERRORS, arm_fault, error_sentence, standing_error_sentence
from hw.lite6.protocol import Code, return_code_sentence

pytestmark = pytest.mark.untimed


def told_of(code: int) -> str:
    fault = arm_fault(code)
    assert fault is not None
    assert fault.code == code
    return fault.text


def test_an_error_of_a_drive_is_told_with_its_own_number_and_advice() -> None:
    hot = arm_fault(13, (0, 0, 15, 0, 0, 0))
    assert hot is not None
    assert hot.text == "C13 (motor of joint 3 failed, S15 overheated): let the arm cool down"
    assert "joint 3 failed, S99): press and release" in error_sentence(13, (0, 0, 99, 0, 0, 0))
    assert "S15" not in error_sentence(31, (0, 0, 15, 0, 0, 0))


def test_error_zero_is_no_fault() -> None:
    assert arm_fault(0) is None
    assert error_sentence(0) == standing_error_sentence(0) == ""


def test_an_error_is_told_with_its_number_its_meaning_and_its_own_advice() -> None:
    told = told_of(24)
    assert told == "C24 (joint too fast): keep away from stretched and folded wrist poses"


def test_an_unknown_error_still_says_where_to_look() -> None:
    assert told_of(97) == "C97: look it up in UFACTORY's user manual"


@pytest.mark.parametrize("code", CONTROLLER_ERRORS)
def test_meaning_and_remedy_fit_into_a_line_of_the_terminal(code: int) -> None:
    told = told_of(code)
    assert len(told) <= 90
    assert not told.endswith(".")


@pytest.mark.parametrize("code", [*CONTROLLER_ERRORS, 99])
def test_every_controller_error_is_one_sentence_with_its_number(code: int) -> None:
    for sentence in (error_sentence(code), standing_error_sentence(code)):
        assert f"C{code}" in sentence
        assert sentence.endswith(".")
        settings = ("limits.max", "arm.tcp", "run_tams.py")
        assert sentence.count(".") == 1 + sum(map(sentence.count, settings))


def test_an_arm_found_in_an_error_has_a_way_out_of_it() -> None:
    assert "then run `run_tams.py home`, which clears it" in standing_error_sentence(2)


def test_return_codes_say_which_call_and_tell_lost_silent_and_refused_apart() -> None:
    codes = (Code.DISCONNECTED, Code.TIMEOUT, Code.NOT_READY, Code.ERROR, 10)
    sentences = [return_code_sentence(code, "a motion command") for code in codes]
    assert len(set(sentences)) == len(codes)
    assert all("a motion command" in sentence for sentence in sentences)
    assert return_code_sentence(Code.NOT_SENT, "x") == return_code_sentence(Code.DISCONNECTED, "x")
