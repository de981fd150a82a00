"""The plant as the rig runs it: the world, with a snapshot published after every cycle."""

from __future__ import annotations

from hw.sim.controller.plant import GripperDrive, PlantState
from hw.sim.world.world import World
from hw.sim.world.world_memory import RigPace, WorldSnapshot, WorldWriter
from tams_app.records import Vector
from tams_app.runtime.clock import NS_PER_MS, Clock

# Further behind the wall clock than this is a standstill whose time is left out. The controller's
# server catches up less than this by running cycles one after the other.
_STANDSTILL_NS = 1_500 * NS_PER_MS


class PublishedWorld:
    """A `Plant` that keeps simulated time on the wall's and says how well it can.

    A snapshot is stamped with the simulated instant: one cycle after the last one, never ahead of
    the clock.
    """

    def __init__(self, world: World, writer: WorldWriter, clock: Clock) -> None:
        self._world = world
        self._writer = writer
        self._clock = clock
        self._now_ns = clock.now_ns()
        self._cycles = self._late = self._skipped = 0
        self._publish()

    def step(self, joints_target: Vector, gripper: GripperDrive, duration_ns: int) -> PlantState:
        state = self._world.step(joints_target, gripper, duration_ns)
        self._keep_time(duration_ns)
        self._publish()
        return state

    def _keep_time(self, duration_ns: int) -> None:
        wall_ns = self._clock.now_ns()
        self._cycles += 1
        self._now_ns = min(self._now_ns + duration_ns, wall_ns)
        behind_ns = wall_ns - self._now_ns
        if behind_ns > duration_ns:
            self._late += 1
        if behind_ns > _STANDSTILL_NS:
            self._skipped += behind_ns // duration_ns
            self._now_ns = wall_ns

    def _publish(self) -> None:
        pace = RigPace(self._cycles, self._late, self._skipped)
        self._writer.publish(WorldSnapshot(self._now_ns, self._world.state(), pace))
