"""The simulated rig in this process, under the caller's clock: arm, world and cameras."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from hw.arms import session_boundary, simulated_arm
from hw.sim.layout import VIEWS, draw_layout
from hw.sim.world.scene_renderer import CameraImages, stagger_ns
from hw.sim.world.world import World
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.records import Frame, SceneTruth, TakeNote, Vector
from tams_app.robot.arm_gate import ArmGate
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.virtual.event_queue import EventQueue

# From the instant a frame shows to the sender: what the live rig takes for drawing and handing
# over (docs/MEASUREMENTS.md, Live and virtual: medians of 18, 11 and 12 ms by view).
DELIVERY_NS = 12 * NS_PER_MS


class VirtualRobot:
    """The simulated rig's scene of `config.seed` with the arm at its ready pose. One thread."""

    def __init__(self, config: Config, clock: Clock, note: TakeNote) -> None:
        joints = np.radians(np.array(config.arm.ready_joints_deg))
        boundary = session_boundary(config.arm, config.limits)
        self.layout = draw_layout(config.seed)
        self._world = World(self.layout, joints)
        self.arm = simulated_arm(config.arm, clock, joints, boundary, self._world)
        self.gate = ArmGate(self.arm, boundary, note)

    def catch_up(self) -> int:
        """Bring arm and world up to the clock; the instant [ns] that they stand at then."""
        self.arm.state()
        return self.arm.simulated_ns

    @property
    def qpos(self) -> Vector:
        """All that a renderer needs to draw the world, shape (nq,)."""
        return self._world.qpos

    def truth(self) -> SceneTruth:
        """The true places of things now: for the trial's rules, never for the operator."""
        return self._world.truth(self.catch_up())

    def stop(self) -> None:
        """Stop the arm for good."""
        self.gate.stop()


class VirtualCameras:
    """Takes the frames of all views of `robot`, 30 a second each, as the renderer does live."""

    def __init__(
        self,
        config: Config,
        robot: VirtualRobot,
        events: EventQueue,
        deliver: Callable[[Frame], None],
    ) -> None:
        """`deliver` is called when the session gets a frame, `DELIVERY_NS` after its instant."""
        unknown = set(config.video.views) - set(VIEWS)
        if unknown:
            raise DeviceError(
                f"the simulated rig has no camera {min(unknown)!r}; use one of {', '.join(VIEWS)}"
            )
        self._views = config.video.views
        self._period_ns = NS_PER_S // config.video.fps
        self._robot = robot
        self._events = events
        self._deliver = deliver
        self._frames = CameraImages(robot.layout, config.seed)

    def start(self, now_ns: int) -> None:
        for view in self._views:
            first_ns = now_ns + stagger_ns(view, self._period_ns)
            self._events.post(first_ns, partial(self._take, view, 0, first_ns))

    def close(self) -> None:
        """Give the graphics back; may be called twice."""
        self._frames.close()

    def _take(self, view: str, index: int, due_ns: int) -> None:
        capture_ns = self._robot.catch_up()
        ready_ns = due_ns + DELIVERY_NS
        image = self._frames.take(view, index, self._robot.qpos)
        frame = Frame(view, index, capture_ns, image, ready_ns)
        self._events.post(ready_ns, partial(self._deliver, frame))
        next_ns = due_ns + self._period_ns
        self._events.post(next_ns, partial(self._take, view, index + 1, next_ns))
