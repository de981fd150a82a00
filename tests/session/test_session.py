"""What a session does when a part of it fails."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tams_app.config import load_config
from tams_app.runtime.clock import VirtualClock
from tams_app.session.session import Session

pytestmark = pytest.mark.waiting


class Noted:
    """An arm and its supervisor: notes what is asked of them."""

    def __init__(self, order: list[str]) -> None:
        self._order = order

    def stop(self) -> None:
        self._order.append("stop")

    def stopped(self) -> None:
        self._order.append("not ready")


def test_a_failure_stops_the_arm_before_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(load_config(None), VirtualClock(), tmp_path)
    order: list[str] = []
    parts: Any = Noted(order)
    session._arm = session._supervisor = parts
    monkeypatch.setattr(session, "note", lambda level, text: order.append(text))
    session.fail("the relay has ended")
    session.fail("so has the log")
    assert order == ["not ready", "stop", "the relay has ended", "not ready", "stop"]
    assert session.failure == "the relay has ended"
    assert session.ended.is_set()
