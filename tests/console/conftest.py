"""What the tests of all faces share."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tams_app.records import Image

VIEWS_DIRECTORY = Path(__file__).parents[1] / "data" / "views"


@pytest.fixture(scope="session")
def pictures() -> dict[str, Image]:
    """A frame of each view, as the rig's cameras gave it."""
    found = {path.stem: cv2.imread(str(path)) for path in VIEWS_DIRECTORY.glob("*.jpg")}
    return {
        view: np.asarray(cv2.resize(image, (640, 480)), np.uint8)
        for view, image in found.items()
        if image is not None
    }
