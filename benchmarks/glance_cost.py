"""What a glance of the seeing operator costs on this machine."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.seeing import SeeingPerception
from hw.sim.operator.task import Stage
from hw.sim.viewpoints import VIEWS
from tams_app.records import Image
from tams_app.units import NS_PER_MS

_VIEWS_DIRECTORY = Path(__file__).with_name("views")  # scene 5, JPEG of quality 60
_GLANCE_NS = 80 * NS_PER_MS
_FIRST = 3  # glances that search the whole images; in a session they are few
_COUNTED = 6  # as often as the container is looked for once in each view


def glance_cpu_s() -> float:
    """Processor time of one glance [s], from glances at stored images: about 0.2 s in all."""
    images = stored_views()
    eyes = SeeingPerception(lambda: images, EfferenceCopy(), sampling_s=0.0, delay_s=0.0)
    began_s = 0.0
    for glance in range(_FIRST + _COUNTED):
        if glance == _FIRST:
            began_s = time.thread_time()
        eyes.watch((glance + 1) * _GLANCE_NS, Stage.REACH)
    return (time.thread_time() - began_s) / _COUNTED


def stored_views() -> dict[str, Image]:
    """The rig at rest with all that the operator looks for, by view."""
    images = {view: cv2.imread(str(_VIEWS_DIRECTORY / f"{view}.jpg")) for view in VIEWS}
    return {view: np.asarray(image, np.uint8) for view, image in images.items()}
