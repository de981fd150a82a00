"""What goes to an operator over the link, and how often."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tams_app.config import load_config
from tams_app.link.messages import SessionDescription, decode
from tams_app.records import Allocation, Phase
from tams_app.robot import linked_operator
from tams_app.robot.control import Signals
from tams_app.robot.linked_operator import LinkedOperator
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import RepairRule
from tests.faces.window.facts import STATE
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.untimed

TICK_NS = NS_PER_S // 120


@pytest.mark.parametrize(
    ("capacity_kbps", "states"), [(None, 60), (20_000.0, 60), (1000.0, 20), (100.0, 10)]
)
def test_states_are_rarer_on_a_narrow_uplink(capacity_kbps: float | None, states: int) -> None:
    """In a second of ticks; None: before the first allocation."""
    clock, sent = VirtualClock(NS_PER_S), []
    log = MemoryJournal(VirtualClock())
    gateway: Any = SimpleNamespace(send=sent.append, event=None)
    operator = LinkedOperator(load_config(), clock, Signals(), log, lambda _: gateway, "robot")
    operator._gateway, operator._sent = gateway, {}
    if capacity_kbps is not None:
        operator.receive(Allocation(0, Phase.REACH, capacity_kbps, 0.0, {}))
    for _ in range(120):
        clock.advance_ns(TICK_NS)
        now_ns = clock.now_ns()
        if operator.wants_state(now_ns):
            made_ns = now_ns + 2 * NS_PER_MS  # what a tick takes until then
            operator.show(msgspec.structs.replace(STATE, now_ns=made_ns))
    assert len(sent) == pytest.approx(states, abs=1)


@pytest.mark.parametrize("fits", [True, False])
def test_what_is_too_much_to_be_told_of_driving_is_left_out_with_a_word(
    monkeypatch: pytest.MonkeyPatch, fits: bool
) -> None:
    if not fits:
        monkeypatch.setattr(linked_operator, "WELCOME_BYTES", 300)
    config = load_config(None, {"limits.max_speed_mm_s": 150.0})
    told: list[bytes] = []
    log = MemoryJournal(VirtualClock())

    def gateway(content: bytes) -> Any:
        told.append(content)
        return SimpleNamespace(launch=lambda: None, wait_ready=lambda: None, entrance_port=1)

    operator = LinkedOperator(config, VirtualClock(NS_PER_S), Signals(), log, gateway, "robot")
    operator.open(RepairRule(True, 60, 300.0), True, {})
    driving = decode(told[0], SessionDescription).driving
    assert driving == ({"limits": {"max_speed_mm_s": 150.0}} if fits else None)
    assert ("as received" in " ".join(log.notes)) is not fits
