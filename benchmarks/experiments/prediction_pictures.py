"""Pictures of the predictive display: a late frame, what is predicted from it, and the true one."""

from __future__ import annotations

import numpy as np

from benchmarks.experiments.prediction_instants import Instant, Recorded
from hw.arms import arm_kind
from hw.sim.layout import draw_layout
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app.config import Config
from tams_app.prediction.plane_warp import WristWarp
from tams_app.records import Image
from tams_app.session.viewing import scene_of

VIEW = "eih"


class Artist:
    """Draws an instant of a trial: late, corrected and true, beside each other."""

    def __init__(self, config: Config, trial: Recorded, seed: int) -> None:
        scene = scene_of(config)
        assert scene.figure is not None
        self._trial, self._figure = trial, scene.figure
        self._warp = WristWarp(
            scene.lenses[VIEW], self._figure.solids[self._figure.flange], self._figure.grip
        )
        self._kinematics = arm_kind(config.arm.model).kinematics(config.arm)
        self._renderer = SceneRenderer(draw_layout(seed))

    def moved_m(self, instant: Instant) -> float:
        """How far the TCP has moved since the frame."""
        places = instant.frame_joints, instant.believed["true pose"]
        then, now = (self._kinematics.tcp_pose(joints).position for joints in places)
        return float(np.linalg.norm(now - then))

    def draw(self, instant: Instant) -> Image:
        late = self._renderer.render(VIEW, self._trial.world.at(instant.frame_ns))
        true = self._renderer.render(VIEW, self._trial.world.at(instant.now_ns))
        poses = instant.frame_joints, instant.believed["forward model"]
        flange = self._figure.flange
        then, now = (self._figure.place(joints)[flange] for joints in poses)
        warped = self._warp.to_now(late, then, now, instant.closed)
        assert warped is not None
        return np.asarray(np.hstack((late, warped.image, true)), np.uint8)

    def close(self) -> None:
        self._renderer.close()
