"""The controller's numbers in words."""

from __future__ import annotations

import pytest

from hw.lite6.codes import (
    Code,
    controller_error_sentence,
    return_code_sentence,
    standing_error_sentence,
)
from tams_app.lite6_errors import CONTROLLER_ERRORS

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize("code", [*CONTROLLER_ERRORS, 99])
def test_every_controller_error_is_one_sentence_with_its_number(code: int) -> None:
    for sentence in (controller_error_sentence(code), standing_error_sentence(code)):
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
