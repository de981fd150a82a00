"""What the rig's cameras show of scene 5 at rest, with all that the operator looks for."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from hw.sim.layout import VIEWS
from tams_app.records import Image

_DIRECTORY = Path(__file__).with_name("data") / "views"  # JPEG of quality 60


def stored_views() -> dict[str, Image]:
    """The images, by view."""
    images = {view: cv2.imread(str(_DIRECTORY / f"{view}.jpg")) for view in VIEWS}
    return {view: np.asarray(image, np.uint8) for view, image in images.items()}
