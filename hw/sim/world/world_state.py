"""One instant of the simulated world as bare numbers, cheap to copy and to publish."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tams_app.records import Pose, SceneTruth, Vector

QPOS_SIZE = 15  # joints 6, fingers 2, block 7


@dataclass(frozen=True, slots=True)
class WorldState:
    """Joint coordinates, shape (QPOS_SIZE,), and what follows from them in the base frame.

    `poses`, shape (3, 7): block, container and TCP, each x y z [m] and quaternion x y z w.
    """

    qpos: Vector
    poses: NDArray[np.float64]
    block_speed: float  # [m/s]
    fingers_opening: float  # [m]

    def truth(self, t_ns: int) -> SceneTruth:
        """The same as a record, stamped `t_ns`."""
        block, container, tcp = (
            Pose(pose[:3].copy(), Rotation.from_quat(pose[3:])) for pose in self.poses
        )
        return SceneTruth(t_ns, block, container, tcp, self.block_speed, self.fingers_opening)
