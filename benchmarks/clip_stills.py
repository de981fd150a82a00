"""docs/calibration/weights-clips.jpg: the middle of one clip of each phase, from a clip folder.

.venv/bin/python -m benchmarks.clip_stills logs/<folder of calibrate weights>/clips
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from calibration.weights.clips import ClipFolder
from tams_app.records import Image, Phase

FIGURE = Path(__file__).resolve().parent.parent / "docs" / "calibration" / "weights-clips.jpg"
SCALE = 0.4


def middle_frame(path: Path) -> Image:
    """The frame in the middle of a clip, made smaller."""
    video = cv2.VideoCapture(str(path))
    video.set(cv2.CAP_PROP_POS_FRAMES, video.get(cv2.CAP_PROP_FRAME_COUNT) // 2)
    there, image = video.read()
    if not there:
        raise SystemExit(f"{path}: cannot be read")
    return np.asarray(cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA))


def main() -> None:
    """One row per phase."""
    paths: dict[Phase, Path] = {}
    for clip in ClipFolder(Path(sys.argv[1])).clips():  # in the order of the phases
        paths.setdefault(clip.phase, clip.path)
    rows = [middle_frame(path) for path in paths.values()]
    cv2.imwrite(str(FIGURE), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 65])


if __name__ == "__main__":
    main()
