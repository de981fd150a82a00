"""What the SDK returned, in words."""

from __future__ import annotations

import pytest

from hw.lite6.codes import Code, return_code_sentence

pytestmark = pytest.mark.untimed


def test_return_codes_say_which_call_and_tell_lost_silent_and_refused_apart() -> None:
    codes = (Code.DISCONNECTED, Code.TIMEOUT, Code.NOT_READY, Code.ERROR, 10)
    sentences = [return_code_sentence(code, "a motion command") for code in codes]
    assert len(set(sentences)) == len(codes)
    assert all("a motion command" in sentence for sentence in sentences)
    assert return_code_sentence(Code.NOT_SENT, "x") == return_code_sentence(Code.DISCONNECTED, "x")
