"""Where a session's cameras see the task, made of its configuration."""

from __future__ import annotations

import numpy as np

from tams_app.config import Config
from tams_app.prediction.task_region import task_region
from tams_app.robot.build import ready_pose
from tams_app.robot.task_regions import TaskRegions
from tams_app.session.viewing import scene_of


def task_regions(config: Config) -> TaskRegions:
    """Of the views whose cameras' poses are known."""
    scene = scene_of(config)
    if scene.figure is None:
        return TaskRegions({}, {})
    flange = scene.figure.flange
    place = scene.figure.place(np.radians(np.array(config.arm.ready_joints_deg)))[flange]
    tcp = place.rotation.inv().apply(ready_pose(config).position - place.position)
    fixed, wrist = {}, {}
    for view, lens in scene.lenses.items():
        if lens.parent == flange:
            wrist[view] = task_region(lens, tcp)
        else:
            fixed[view] = lens
    return TaskRegions(fixed, wrist)
