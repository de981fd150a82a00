"""The simulated rig's world and arm controller, a helper process of its own.

Specification: memory_name, seed, start_joints_deg. Ready facts: control_port, report_port. It may
be sent put_back: how often the block was asked to be put back to its start so far.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hw.arm import PlantState
from hw.sim.controller.model import ControllerModel
from hw.sim.controller.server import ControllerServer
from hw.sim.layout import draw_layout
from hw.sim.world.rig_memory import WorldWriter, remove_memory
from hw.sim.world.world import World
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import RIG_PRIORITY, use_fifo
from tams_app.units import NS_PER_MS
from tams_app.vectors import Joints

# Further behind the wall clock than this is a standstill whose time is left out. The controller's
# server catches up less than this by running cycles one after the other.
_STANDSTILL_NS = 1_500 * NS_PER_MS


class PublishedWorld:
    """A `Plant` in real time: the world, published after every cycle.

    A state is stamped with the simulated instant: one cycle after the last one, never ahead of the
    clock.
    """

    def __init__(self, world: World, writer: WorldWriter, clock: Clock, side: HelperSide) -> None:
        """`side` is sent put_back, which is done between two cycles, once nothing is in the way."""
        self._side, self._put_back = side, 0
        self._world = world
        self._writer = writer
        self._clock = clock
        self._now_ns = clock.now_ns()
        writer.publish(self._now_ns, world.state())

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        asked = int(self._side.received.get("put_back", 0))
        if asked != self._put_back and self._world.put_back():
            self._put_back = asked
        state = self._world.step(joints_target, closing, duration_ns)
        wall_ns = self._clock.now_ns()
        self._now_ns = min(self._now_ns + duration_ns, wall_ns)
        if wall_ns - self._now_ns > _STANDSTILL_NS:
            self._now_ns = wall_ns
        self._writer.publish(self._now_ns, self._world.state())
        return state


def main() -> None:
    side = HelperSide()
    with side.failing():
        failure = _serve(side, side.specification)
    if failure is not None:
        raise failure


def _serve(side: HelperSide, specification: dict[str, Any]) -> BaseException | None:
    """Run until stop is requested; what ended a thread of the server, if anything did."""
    name = str(specification["memory_name"])
    start_joints = np.radians(np.array(specification["start_joints_deg"], float))
    clock = MonotonicClock()
    world = World(draw_layout(int(specification["seed"])), start_joints)
    writer = WorldWriter(name)
    plant = PublishedWorld(world, writer, clock, side)
    model = ControllerModel(plant, start_joints)
    server = ControllerServer(model, clock=clock, ended=side.stop_requested)
    use_fifo(RIG_PRIORITY)  # which the threads started afterwards inherit
    try:
        server.start()
        ports = server.ports
        side.ready(control_port=ports.control, report_port=ports.report)
        side.stop_requested.wait()
    finally:
        server.close()
        writer.close()
        remove_memory(name)  # the session that chose the name may have been killed
    return server.failure


if __name__ == "__main__":
    main()
