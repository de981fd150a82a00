"""Where a session's cameras see the task in the captured frames, by the newest state of the arm.

What matters in pick and place is at the gripper: its fingers, what they hold or are about to hold,
and what is right below. The region is the disc in which a camera sees a ball about the tool centre
point, so no picture is looked at to find it, and it is the same whatever the picture shows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tams_app.config import Config
from tams_app.prediction.plane_warp import projected
from tams_app.records import Frame, Lens, Record, TaskRegion, Tick, Vector
from tams_app.robot.listener import Listener
from tams_app.session.viewing import scene_of, tool_tip

RADIUS_M = 0.06  # of the ball: the fingers, what they hold, and as much before them
LEAST_RADIUS_PX = 40.0  # a smaller disc would be few of the encoder's blocks of 16 pixels


class TaskRegions(Listener):
    """Gives each captured frame its task's region, by the newest state of the arm.

    That is a few milliseconds older or newer than the frame, in which the arm moves less than a
    millimetre or two.
    """

    def __init__(self, fixed: Mapping[str, Lens], wrist: Mapping[str, TaskRegion | None]) -> None:
        """By view: `fixed`, the lenses in the base frame; `wrist`, the regions of cameras that move
        with the tool, which therefore stays where it is in their pictures.
        """
        self._fixed, self._wrist = fixed, wrist
        self._tcp: Vector | None = None

    def receive(self, record: Record) -> None:
        """In the control thread; cameras' threads read it."""
        if isinstance(record, Tick) and record.arm is not None:
            self._tcp = record.arm.tcp.position

    def through(self, consume: Callable[[Frame], None]) -> Callable[[Frame], None]:
        """What gives frames to `consume` with their region; each view from one thread."""
        return lambda frame: consume(replace(frame, task=self.of(frame.view)))

    def of(self, view: str) -> TaskRegion | None:
        """The region now; None: the camera or the arm is not known, or the tool is out of sight."""
        lens, tcp = self._fixed.get(view), self._tcp
        if lens is None or tcp is None:
            return self._wrist.get(view)
        return task_region(lens, tcp)


def task_regions(config: Config) -> TaskRegions:
    """Of the views whose cameras' poses are known."""
    scene = scene_of(config)
    if scene.figure is None:
        return TaskRegions({}, {})
    flange = scene.figure.flange
    tip = np.array(tool_tip(config, scene.figure))
    fixed, wrist = {}, {}
    for view, lens in scene.lenses.items():
        if lens.parent == flange:
            wrist[view] = task_region(lens, tip)
        else:
            fixed[view] = lens
    return TaskRegions(fixed, wrist)


def task_region(lens: Lens, tcp: Vector) -> TaskRegion | None:
    """The region that `lens` sees; None: the TCP is out of its sight.

    `tcp`: position in the frame of the lens's parent [m], shape (3,).
    """
    pixels = projected(tcp.reshape(1, 3), lens)
    if not len(pixels):
        return None
    x_px, y_px = pixels[0].tolist()
    if not (0.0 <= x_px < lens.width and 0.0 <= y_px < lens.height):
        return None
    depth_m = float(lens.pose.rotation.inv().apply(tcp - lens.pose.position)[2])
    radius_px = max(LEAST_RADIUS_PX, RADIUS_M * float(lens.matrix()[0, 0]) / depth_m)
    return TaskRegion(x_px, y_px, radius_px)
