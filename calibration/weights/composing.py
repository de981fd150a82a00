"""The views side by side, as they were at the same instants. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import cv2
import numpy as np

from calibration.weights.decoding import Picture
from calibration.weights.segments import Segment
from tams_app.records import Image
from tams_app.runtime.clock import NS_PER_S

STRIP_HEIGHT = 32  # above the pictures, for their names
_TEXT_BASELINE = 23
_TEXT_SCALE = 0.7
_INK, _PAPER = (255, 255, 255), 40


def instants(segment: Segment, fps: int) -> list[int]:
    """When a clip of `segment` needs pictures [ns]; at least one."""
    count = max(1, (segment.end_ns - segment.start_ns) * fps // NS_PER_S)
    return [segment.start_ns + number * NS_PER_S // fps for number in range(count)]


def newest_at(
    pictures: Iterable[Picture], wanted_ns: Sequence[int]
) -> Iterator[tuple[int, dict[str, Image]]]:
    """For each of `wanted_ns`, ascending: the newest picture of each view captured by then.

    `pictures` come in the order of their captures. Reads on no further than it has to.
    """
    if not wanted_ns:
        return
    newest: dict[str, Image] = {}
    number = 0
    for picture in pictures:
        while picture.capture_ns > wanted_ns[number]:
            yield wanted_ns[number], dict(newest)
            number += 1
            if number == len(wanted_ns):
                return
        newest[picture.view] = picture.image
    for instant in wanted_ns[number:]:
        yield instant, dict(newest)


def side_by_side(images: Mapping[str, Image], views: Sequence[str], phase: str) -> Image:
    """The views in one row under their names, and the phase's at the right; BGR."""
    pictures = np.hstack([images[view] for view in views])
    height, width = pictures.shape[:2]
    canvas = np.full((height + STRIP_HEIGHT, width, 3), _PAPER, dtype=np.uint8)
    canvas[STRIP_HEIGHT:] = pictures
    for number, view in enumerate(views):
        _write(canvas, view.upper(), number * width // len(views) + 8)
    (length, _), _ = cv2.getTextSize(phase, cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE, 2)
    _write(canvas, phase, width - length - 8)
    return canvas


def _write(canvas: Image, text: str, x: int) -> None:
    at, font = (x, _TEXT_BASELINE), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(canvas, text, at, font, _TEXT_SCALE, _INK, 2, cv2.LINE_AA)
