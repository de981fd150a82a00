"""Short trials in virtual time; as a program it prints the digest of one, for a fresh process.

`python -m tests.session.virtual.runs FOLDER`
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2

from tams_app.config import Config, load_config
from tams_app.recording import LOG_NAME
from tams_app.records import Outcome, ShownFrame
from tams_app.session.virtual.trial import VirtualTrial

WALL_NS = 1_800_000_000_000_000_000
PARTICIPANT = 3
LONG_ENOUGH = {"network": "s3", "seconds": 4.0}  # until the operator has engaged the arm


def short(**changes: Any) -> Config:
    """A trial of seed 5 with a third of the frames, for dotted keys in `changes`."""
    return load_config(None, {"seed": 5, "video.fps": 10, **changes})


def run(
    config: Config, folder: Path, watch: Callable[[ShownFrame], None] = lambda _: None
) -> Outcome:
    """One trial of one participant; its log is in `folder` then."""
    cv2.setNumThreads(1)
    folder.mkdir(parents=True, exist_ok=True)
    with closing(VirtualTrial(config, PARTICIPANT, folder, WALL_NS)) as trial:
        shown = trial._scores.shown

        def seen(frame: ShownFrame) -> None:
            shown(frame)
            watch(frame)

        trial._scores.shown = seen  # type: ignore[method-assign]
        return trial.run()


def digest_of_run(folder: Path) -> str:
    """One number for every frame shown and every byte of the log."""
    sha = sha256()

    def watch(shown: ShownFrame) -> None:
        sha.update(f"{shown.view} {shown.index} {shown.shown_ns}".encode())
        sha.update(shown.image.tobytes())

    run(short(**LONG_ENOUGH), folder, watch)
    sha.update((folder / LOG_NAME).read_bytes())
    return sha.hexdigest()


if __name__ == "__main__":
    sys.stdout.write(digest_of_run(Path(sys.argv[1])) + "\n")
