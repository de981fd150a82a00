"""What is where on a photograph of the window: pictures by the colour of their frames, banner."""

from __future__ import annotations

import cv2
import numpy as np

from tams_app import palette
from tams_app.faces.banner import look_of
from tams_app.records import Image
from tests.faces.window.facts import FACTS

_TITLE_PX = 28  # the view's name is written over the picture's upper edge
SAME = 8.0  # mean difference of grey levels, without what scaling adds or takes


def is_colour(image: Image, colour: str) -> np.ndarray:
    """Which pixels have it, shape (height, width)."""
    bgr = np.array([round(255 * share) for share in palette.rgb(colour)][::-1], np.uint8)
    return (np.abs(image.astype(int) - bgr).max(axis=2) <= 2).astype(bool)


def place_of(photograph: Image, view: str) -> tuple[slice, slice] | None:
    """Rows and columns of the picture of `view`, found by the upper edge of its frame."""
    colour = palette.view_colour(list(FACTS.state.views).index(view))
    edge = is_colour(photograph, colour)
    rows = np.flatnonzero(edge.sum(axis=1) > 200)
    if len(rows) < 5:
        return None
    columns = np.flatnonzero(edge[rows[0]])
    left, right = columns[0] + 2, columns[-1] - 1
    below = np.flatnonzero(edge[rows[0] :, left - 2])
    top = rows[0] + 5
    run = np.flatnonzero(np.diff(below) > 1)
    bottom = rows[0] + (below[run[0]] if len(run) else below[-1]) - 1
    return slice(top, bottom), slice(left, right)


def difference(photograph: Image, view: str, published: Image) -> float:
    """Mean difference between the picture of `view` and what was published, below its name."""
    place = place_of(photograph, view)
    if place is None:
        return 255.0
    seen = photograph[place]
    height, width = seen.shape[:2]
    scale = min(width / published.shape[1], height / published.shape[0])
    size = round(published.shape[1] * scale), round(published.shape[0] * scale)
    expected = cv2.resize(published, size, interpolation=cv2.INTER_AREA)
    y, x = (height - size[1]) // 2, (width - size[0]) // 2
    inner = seen[y : y + size[1], x : x + size[0]]
    coarse = [cv2.GaussianBlur(one, (0, 0), 2.0).astype(int) for one in (inner, expected)]
    return float(np.abs(coarse[0] - coarse[1])[_TITLE_PX:].mean())


def width_of(photograph: Image, view: str) -> int:
    place = place_of(photograph, view)
    return 0 if place is None else place[1].stop - place[1].start


def banner_is(photograph: Image, arming: str) -> bool:
    """Whether banner and border have the colour of that state, in a window of 1280x720."""
    colour = look_of(arming).colour
    banner = is_colour(photograph[8:78, 300:1100], colour).mean()
    return bool(banner > 0.5 and is_colour(photograph[100:700, :6], colour).mean() > 0.2)
