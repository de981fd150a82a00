"""The statistics that learners normalise by: of one episode, and of several put together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.video.core.colour import Planes, bgr_of

Values: TypeAlias = NDArray[np.float64]
Statistics: TypeAlias = dict[str, Values]
"""min, max, mean, std, count and quantiles of a feature."""

_QUANTILES = {f"q{round(100 * share):02d}": share for share in (0.01, 0.10, 0.50, 0.90, 0.99)}
_LEVELS = np.arange(256)


def statistics_of(column: NDArray[Any]) -> Statistics:
    """Of numbers, shape (n,) or (n, size); each but the count has shape (size,)."""
    rows = np.asarray(column, np.float64).reshape(len(column), -1)
    found = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        "count": np.array([len(rows)]),
    }
    quantiles = np.quantile(rows, list(_QUANTILES.values()), axis=0)
    return found | dict(zip(_QUANTILES, quantiles, strict=True))


class PixelStatistics:
    """Of the pixels of some frames, by colour, from 0 to 1; a histogram is all that is kept."""

    _STRIDE = 4  # of the pixels looked at, in both directions

    def __init__(self) -> None:
        self._frames = 0
        self._histogram = np.zeros((3, len(_LEVELS)), np.int64)

    def add(self, planes: Planes, height: int, width: int) -> None:
        """Count a frame's pixels: red, green and blue."""
        pixels = cv2.cvtColor(bgr_of(planes, height, width), cv2.COLOR_BGR2RGB)
        seen = pixels[:: self._STRIDE, :: self._STRIDE].reshape(-1, 3)
        for channel in range(3):
            self._histogram[channel] += np.bincount(seen[:, channel], minlength=len(_LEVELS))
        self._frames += 1

    def result(self) -> Statistics:
        """Each of shape (3, 1, 1) but the count, which is of frames."""
        pixels = self._histogram.sum(axis=1)
        cumulated = np.cumsum(self._histogram, axis=1)
        mean = self._histogram @ _LEVELS / pixels
        spread = self._histogram @ _LEVELS**2 / pixels - mean**2

        def level(share: float) -> Values:
            reached = cumulated >= np.maximum(share * pixels, 1)[:, None]
            return np.asarray(np.argmax(reached, axis=1), np.float64)

        found = {
            "min": level(0.0),
            "max": level(1.0),
            "mean": mean,
            "std": np.sqrt(np.maximum(spread, 0.0)),
            **{name: level(share) for name, share in _QUANTILES.items()},
        }
        scaled = {name: (value / 255).reshape(3, 1, 1) for name, value in found.items()}
        return scaled | {"count": np.array([self._frames])}


def merged(episodes: Sequence[Statistics]) -> Statistics:
    """Of several episodes as if they were one; quantiles are the weighted means of theirs."""
    stacked = {name: np.stack([one[name] for one in episodes]) for name in episodes[0]}
    counts = stacked["count"].reshape(-1, *(1,) * (stacked["mean"].ndim - 1))

    def weighted(values: Values) -> Values:
        return np.asarray(np.sum(values * counts, axis=0) / counts.sum())

    mean = weighted(stacked["mean"])
    return {
        "min": stacked["min"].min(axis=0),
        "max": stacked["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(weighted(stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2)),
        "count": stacked["count"].sum(axis=0),
        **{name: weighted(stacked[name]) for name in _QUANTILES},
    }


def as_lists(statistics: Mapping[str, Statistics]) -> dict[str, dict[str, Any]]:
    """By feature, for JSON and Parquet."""
    return {
        feature: {name: value.tolist() for name, value in found.items()}
        for feature, found in statistics.items()
    }
