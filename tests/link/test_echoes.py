from __future__ import annotations

import pytest

from tams_app.link.echoes import PREFIX, answer, number_of, ping

pytestmark = pytest.mark.untimed


def test_an_echo_comes_back_with_its_number():
    echo = answer(ping(17))
    assert echo is not None
    assert number_of(echo) == 17


@pytest.mark.parametrize("message", [b"", PREFIX, b"\0pong", b"\0pong\0", b"\0ask\0\0\0\1", b"m"])
def test_what_is_no_ping_has_no_answer_and_what_is_no_echo_no_number(message: bytes):
    assert answer(message) is None
    assert number_of(message) is None
