"""The rig's cameras in virtual time: each frame at its instant, handed over a little later."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from hw.sim.viewpoints import VIEWS
from hw.sim.world.camera_images import CameraImages, stagger_ns
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S
from tams_app.session.virtual.robot import VirtualRobot
from tams_app.video.virtual_time.event_queue import EventQueue

# From the instant a frame shows to the sender: what the live rig takes for drawing and handing
# over (`make bench`, "before: rendering and hand-over" p50); a USB camera takes about as long.
DELIVERY_NS = 23 * NS_PER_MS


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
        sigma = config.rig.camera_noise_sigma
        self._frames = CameraImages(robot.layout, config.seed, sigma)

    def start(self, now_ns: int) -> None:
        """Begin the grid of each view."""
        for view in self._views:
            first_ns = now_ns + stagger_ns(view, self._period_ns)
            self._events.post(first_ns, partial(self._take, view, 0, first_ns))

    def close(self) -> None:
        """Give the graphics back; may be called twice."""
        self._frames.close()

    def _take(self, view: str, index: int, due_ns: int) -> None:
        capture_ns = self._robot.catch_up()
        frame = Frame(view, index, capture_ns, self._frames.take(view, index, self._robot.qpos))
        self._events.post(due_ns + DELIVERY_NS, partial(self._deliver, frame))
        next_ns = due_ns + self._period_ns
        self._events.post(next_ns, partial(self._take, view, index + 1, next_ns))
