"""The size that the window had when it was closed, kept for the next time."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from tams_app.errors import TamsError

LEAST_WIDTH, LEAST_HEIGHT = 640, 400


@dataclass(frozen=True, slots=True)
class Size:
    """In pixels of the screen; where the window stands the window manager decides."""

    width: int = 1280
    height: int = 720
    maximised: bool = False


USUAL = Size()


def size_file(environment: Mapping[str, str] = os.environ) -> Path:
    """The file of the size: a state of the user (XDG base directories)."""
    state = environment.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "tams" / "window.json"


def first_size(screen_width: int, screen_height: int) -> Size:
    """The size before any is kept: maximised where the usual one would fill most of the screen."""
    fills_most = 2 * USUAL.width * USUAL.height > screen_width * screen_height
    return Size(maximised=fills_most)


def read_size(path: Path, first: Size = USUAL) -> Size:
    """The size kept there; `first` if there is nothing of use."""
    try:
        size = Size(**json.loads(path.read_text()))
        usable = size.width >= LEAST_WIDTH and size.height >= LEAST_HEIGHT
    except (OSError, ValueError, TypeError):
        return first
    return size if usable else first


def keep_size(path: Path, size: Size) -> None:
    """Keep `size`; TamsError if that is impossible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(size)) + "\n")
    except OSError as error:
        raise TamsError(f"{path}: the window's size cannot be kept: {error.strerror}") from error
