"""The README's frames from a session: `python -m benchmarks.frames LOG_FOLDER`.

docs/views.jpg: what the operator saw of the three views at three moments; docs/bitrates.png.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from tams_app.recording import SessionLog, read_log, read_video
from tams_app.records import Image, Phase

DOCS = Path(__file__).parent.parent / "docs"
MOMENTS = (Phase.ALIGN, Phase.GRASP, Phase.TRANSPORT)
DELAY_NS = 500_000_000  # into the phase: by then its bits have arrived
SCALE = 0.6


def frame_at(folder: Path, log: SessionLog, view: str, t_ns: int) -> Image:
    """The frame of `view` last sent before `t_ns`, decoded."""
    sent = [frame for frame in log.sent if frame.view == view and frame.encoded_ns <= t_ns]
    with tempfile.NamedTemporaryFile(suffix=".h264") as stream:
        frames = list(read_video(folder / "session.mcap", view))
        for frame in frames[: len(sent)]:
            stream.write(frame.data)
        stream.flush()
        video = cv2.VideoCapture(stream.name)
        image = None
        while (decoded := video.read())[0]:
            image = decoded[1]
        video.release()
    if image is None:
        raise SystemExit(f"{folder}: nothing of view {view} can be decoded")
    return np.asarray(image, np.uint8)


def label(image: Image, text: str) -> Image:
    small = cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
    cv2.rectangle(small, (0, 0), (12 + 11 * len(text), 26), (0, 0, 0), -1)
    cv2.putText(
        small, text, (8, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA
    )
    return np.asarray(small, np.uint8)


def main() -> None:
    folder = Path(sys.argv[1])
    log = read_log(folder / "session.mcap")
    rows = []
    for phase in MOMENTS:
        t_ns = next(change.t_ns for change in log.phases if change.phase is phase) + DELAY_NS
        targets = [one for one in log.allocations if one.t_ns <= t_ns][-1].target_kbps
        cells = [
            label(
                frame_at(folder, log, view, t_ns),
                f"{view.upper()}  {phase.value}  {targets[view]} kbit/s",
            )
            for view in log.header.views
        ]
        rows.append(np.hstack(cells))
    cv2.imwrite(str(DOCS / "views.jpg"), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])
    shutil.copyfile(folder / "bitrates.png", DOCS / "bitrates.png")


if __name__ == "__main__":
    main()
