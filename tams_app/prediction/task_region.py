"""Where the task is in a camera's picture, from the arm's pose alone.

What matters in pick and place is at the gripper: its fingers, what they hold or are about to hold,
and what is right below. The region is the disc in which a camera sees a ball about the tool centre
point, so no picture is looked at to find it, and it is the same whatever the picture shows.
"""

from __future__ import annotations

from tams_app.prediction.plane_warp import projected
from tams_app.records import Lens, TaskRegion, Vector

RADIUS_M = 0.06  # of the ball: the fingers, what they hold, and as much before them
LEAST_RADIUS_PX = 40.0  # a smaller disc would be few of the encoder's blocks of 16 pixels


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
