"""The reports as the guard reads them: what a failing connection does to it."""

from __future__ import annotations

import errno
import socket
from typing import Any, NoReturn

import pytest

from hw.lite6.report_watch import REAL_PORT_OFFSET, Lite6ReportWatch
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed


def test_a_connection_that_cannot_be_made_anew_is_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where the computer has no socket left: the guard goes on, and is blind meanwhile."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5.0)
        watch = Lite6ReportWatch("127.0.0.1", server.getsockname()[1] - REAL_PORT_OFFSET)
        watch.start()
        assert watch.newest(0) is None

        def refused(*_: Any) -> NoReturn:
            raise OSError(errno.ENFILE, "Too many open files in system")

        with monkeypatch.context() as full:
            full.setattr(socket, "socket", refused)
            assert watch.newest(NS_PER_S) is None
        assert watch.newest(2 * NS_PER_S) is None
        for _ in range(2):
            connection, _ = server.accept()
            connection.close()
        watch.close()
