"""Where a session's cameras see the task, made of its configuration."""

from __future__ import annotations

import numpy as np

from tams_app.config import Config
from tams_app.prediction.task_region import task_region
from tams_app.robot.task_regions import TaskRegions
from tams_app.session.viewing import scene_of, tool_tip


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
