"""The statistics that learners normalise by, of one episode or of all rows of a dataset."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.video.core.codecs import Planes, bgr_of

Statistics: TypeAlias = dict[str, list[Any]]
"""min, max, mean, std, count and quantiles of a feature."""

_QUANTILES = {f"q{round(100 * share):02d}": share for share in (0.01, 0.10, 0.50, 0.90, 0.99)}
_LEVELS = np.arange(256) / 255
_STRIDE = 4  # of the pixels looked at, in both directions


def statistics_of(column: NDArray[Any]) -> Statistics:
    """Of numbers, shape (n,) or (n, size); each but the count has shape (size,)."""
    rows = np.asarray(column, np.float64).reshape(len(column), -1)
    return {
        "min": rows.min(axis=0).tolist(),
        "max": rows.max(axis=0).tolist(),
        "mean": rows.mean(axis=0).tolist(),
        "std": rows.std(axis=0).tolist(),
        "count": [len(rows)],
        **{name: np.quantile(rows, share, axis=0).tolist() for name, share in _QUANTILES.items()},
    }


class PixelStatistics:
    """Of the pixels of some frames, by colour, from 0 to 1; a histogram is all that is kept."""

    def __init__(self) -> None:
        self._frames = 0
        self._histogram = np.zeros((3, len(_LEVELS)), np.int64)

    def add(self, planes: Planes, height: int, width: int) -> None:
        """Count a frame's pixels: red, green and blue."""
        pixels = cv2.cvtColor(bgr_of(planes, height, width), cv2.COLOR_BGR2RGB)
        seen = pixels[::_STRIDE, ::_STRIDE].reshape(-1, 3)
        for channel in range(3):
            self._histogram[channel] += np.bincount(seen[:, channel], minlength=len(_LEVELS))
        self._frames += 1

    def include(self, other: PixelStatistics) -> None:
        """Count the frames that `other` has counted too."""
        self._histogram += other._histogram
        self._frames += other._frames

    def result(self) -> Statistics:
        """Each of shape (3, 1, 1) but the count, which is of frames."""
        pixels = self._histogram.sum(axis=1)
        mean = self._histogram @ _LEVELS / pixels
        variance = self._histogram @ _LEVELS**2 / pixels - mean**2
        found = {"mean": mean, "std": np.sqrt(np.maximum(variance, 0.0))}
        for name, share in ({"min": 0.0, "max": 1.0} | _QUANTILES).items():
            reached = self._histogram.cumsum(axis=1) >= np.maximum(share * pixels, 1)[:, None]
            found[name] = _LEVELS[reached.argmax(axis=1)]
        levels = {name: value.reshape(3, 1, 1).tolist() for name, value in found.items()}
        return levels | {"count": [self._frames]}
