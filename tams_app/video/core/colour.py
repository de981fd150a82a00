"""The colours of frames on their way through the codec: BGR to I420 and back (BT.601).

By OpenCV in place of GStreamer's videoconvert: a fifth of its time there and two fifths back, and
what comes back is nearer to what entered, by 4 dB or more (`benchmarks.colour` at 628dd78b). The
chroma of four pixels is that of the upper left one.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image

Planes = NDArray[np.uint8]


def i420_of(image: Image) -> Planes:
    """Y, U and V one after the other, shape (3/2 height, width), of a BGR image.

    Rows have no padding, as GStreamer lays them out for widths that are multiples of 8.
    """
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), np.uint8)


def bgr_of(planes: Planes, height: int, width: int) -> Image:
    """The BGR image, shape (height, width, 3), of a frame's I420 planes in any shape."""
    stacked = planes.reshape(height * 3 // 2, width)
    return np.asarray(cv2.cvtColor(stacked, cv2.COLOR_YUV2BGR_I420), np.uint8)
