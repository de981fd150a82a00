"""The rig's world in real time: published after every cycle, never ahead of the clock."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from hw.sim.layout import draw_layout
from hw.sim.rig import PublishedWorld
from hw.sim.world.rig_memory import WorldReader, WorldState, WorldWriter, remove_memory
from hw.sim.world.world import World
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_S
from tests.hw.sim.operator.scripted_pick import CYCLE_NS, READY

pytestmark = pytest.mark.untimed


class Rig:
    """A published world on a virtual clock, with its reader."""

    def __init__(self, name: str) -> None:
        self.clock = VirtualClock()
        self.writer = WorldWriter(name)
        self.world = World(draw_layout(0), READY)
        self.side: Any = SimpleNamespace(received={})
        self.plant = PublishedWorld(self.world, self.writer, self.clock, self.side)
        self.reader = WorldReader(name)

    def cycle(self, wall_ns: int = CYCLE_NS) -> tuple[int, WorldState]:
        self.clock.advance_ns(wall_ns)
        self.plant.step(READY, True, CYCLE_NS)
        newest = self.reader.read()
        assert newest is not None
        return newest


@pytest.fixture
def rig() -> Iterator[Rig]:
    name = new_block_name()
    rig = Rig(name)
    yield rig
    rig.reader.close()
    rig.writer.close()
    remove_memory(name)


def test_each_cycle_publishes_the_world_at_its_simulated_instant(rig: Rig) -> None:
    for _ in range(5):
        t_ns, state = rig.cycle()
        assert t_ns == rig.clock.now_ns()
        assert state.qpos == tuple(rig.world.qpos)
    truth = rig.reader.truth()
    assert truth is not None
    assert truth.fingers_opening < 0.016


def test_cycles_caught_up_after_a_hiccup_lose_no_time(rig: Rig) -> None:
    start_ns = rig.clock.now_ns()
    assert rig.cycle(10 * CYCLE_NS)[0] == start_ns + CYCLE_NS
    for _ in range(9):
        t_ns, _ = rig.cycle(0)
    assert t_ns == rig.clock.now_ns()


def test_a_standstill_is_left_out(rig: Rig) -> None:
    assert rig.cycle(3 * NS_PER_S)[0] == rig.clock.now_ns()


def test_simulated_time_is_never_ahead_of_the_clock(rig: Rig) -> None:
    assert rig.cycle(CYCLE_NS // 2)[0] == rig.clock.now_ns()


def test_the_block_is_put_back_once_for_each_time_as_soon_as_it_can_be(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter((False, False, True, True))
    tried: list[bool] = []

    def put_back() -> bool:
        tried.append(next(answers))
        return tried[-1]

    monkeypatch.setattr(rig.world, "put_back", put_back)
    rig.cycle()
    assert tried == []
    rig.side.received = {"put_back": 1}
    for _ in range(5):
        rig.cycle()
    assert tried == [False, False, True]
    rig.side.received = {"put_back": 2}
    for _ in range(5):
        rig.cycle()
    assert tried == [False, False, True, True]
