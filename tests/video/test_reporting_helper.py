"""What a helper says arrives to its last byte, however it ends."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import pytest

from tams_app.video.reporting_helper import received

pytestmark = pytest.mark.waiting

Pair = tuple[socket.socket, socket.socket]
RESET_ON_CLOSE = struct.pack("ii", 1, 0)  # struct linger: on, at once


@pytest.fixture
def ends() -> Iterator[Pair]:
    """The session's end and the helper's."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        helper = socket.create_connection(listener.getsockname())
        session, _ = listener.accept()
    with session, helper:
        yield session, helper


def test_what_was_said_before_hanging_up_is_heard(ends: Pair) -> None:
    session, helper = ends
    helper.sendall(b"first, last")
    helper.close()
    assert b"".join(received(session, threading.Event())) == b"first, last"


def test_a_reset_is_an_end_like_any_other(ends: Pair) -> None:
    session, helper = ends
    helper.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET_ON_CLOSE)
    helper.close()
    assert list(received(session, threading.Event())) == []


def test_after_a_stop_it_ends_once_nothing_more_is_said(ends: Pair) -> None:
    session, helper = ends
    helper.sendall(b"still on its way")
    stop = threading.Event()
    stop.set()
    assert b"".join(received(session, stop)) == b"still on its way"


def test_silence_alone_ends_nothing(ends: Pair) -> None:
    session, helper = ends
    stop = threading.Event()

    def speak_late() -> None:
        stop.wait(0.5)  # longer than it waits at once
        helper.sendall(b"late")
        helper.close()

    speaker = threading.Thread(target=speak_late)
    speaker.start()
    heard = list(received(session, stop))
    speaker.join()
    assert heard == [b"late"]
