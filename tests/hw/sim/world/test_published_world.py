from __future__ import annotations

from collections.abc import Iterator

import pytest

from hw.sim.controller.plant import GripperDrive
from hw.sim.layout import draw_layout
from hw.sim.world.published_world import PublishedWorld
from hw.sim.world.shared_block import new_memory_name, remove_memory
from hw.sim.world.world import World
from hw.sim.world.world_memory import RigPace, WorldReader, WorldSnapshot, WorldWriter
from tams_app.runtime.clock import NS_PER_S, VirtualClock
from tests.hw.sim.operator.scripted_pick import CYCLE_NS, READY

pytestmark = pytest.mark.untimed


class Rig:
    """A published world on a virtual clock, with its reader."""

    def __init__(self, name: str) -> None:
        self.clock = VirtualClock()
        self.writer = WorldWriter(name)
        self.world = World(draw_layout(0), READY)
        self.plant = PublishedWorld(self.world, self.writer, self.clock)
        self.reader = WorldReader(name)

    def cycle(self, wall_ns: int = CYCLE_NS) -> WorldSnapshot:
        self.clock.advance_ns(wall_ns)
        self.plant.step(READY, GripperDrive.CLOSE, CYCLE_NS)
        snapshot = self.reader.read()
        assert snapshot is not None
        return snapshot


@pytest.fixture
def rig() -> Iterator[Rig]:
    name = new_memory_name()
    rig = Rig(name)
    yield rig
    rig.reader.close()
    rig.writer.close()
    remove_memory(name)


def test_each_cycle_publishes_the_world_at_its_simulated_instant(rig: Rig) -> None:
    for _ in range(5):
        snapshot = rig.cycle()
        assert snapshot.t_ns == rig.clock.now_ns()
        assert (snapshot.state.qpos == rig.world.qpos).all()
    assert snapshot.pace == RigPace(5, 0, 0)
    assert snapshot.truth.fingers_opening < 0.016


def test_cycles_caught_up_after_a_hiccup_count_as_late_and_lose_no_time(rig: Rig) -> None:
    start_ns = rig.clock.now_ns()
    late = rig.cycle(10 * CYCLE_NS)
    assert late.t_ns == start_ns + CYCLE_NS
    for _ in range(9):
        snapshot = rig.cycle(0)
    assert snapshot.t_ns == rig.clock.now_ns()
    assert snapshot.pace == RigPace(10, 8, 0)


def test_standstill_is_left_out_and_counted(rig: Rig) -> None:
    snapshot = rig.cycle(3 * NS_PER_S)
    assert snapshot.t_ns == rig.clock.now_ns()
    assert snapshot.pace.skipped == 3 * NS_PER_S // CYCLE_NS - 1


def test_simulated_time_is_never_ahead_of_the_clock(rig: Rig) -> None:
    assert rig.cycle(CYCLE_NS // 2).t_ns == rig.clock.now_ns()
