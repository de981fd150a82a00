"""A view's frames as they were sent, each held until the next was captured."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from itertools import takewhile

from tams_app.errors import UnreadableLogError
from tams_app.export.lerobot.episode import Episode
from tams_app.recording import read_video
from tams_app.records import EncodedFrame
from tams_app.video.core.colour import Planes
from tams_app.video.live.recorded import decoded


def frames_on_grid(episode: Episode, view: str) -> Generator[Planes]:
    """The newest frame captured at each instant of the episode's grid, as I420 planes.

    At any time one frame is kept. UnreadableLogError if the view cannot be decoded.
    """
    shape, grid_ns = episode.shape, episode.grid_ns
    size = shape.width * shape.height * 3 // 2
    held: Planes | None = None
    row = 0
    with closing(decoded(_units(episode, view, int(grid_ns[-1])))) as frames:
        for capture_ns, planes in frames:
            if planes.size != size:
                raise UnreadableLogError(
                    f"{episode.path.parent}: the frames of {view} are not of "
                    f"{shape.width}x{shape.height} as its header says"
                )
            while held is not None and grid_ns[row] < capture_ns:
                yield held
                row += 1
            held = planes
    if held is None:
        raise UnreadableLogError(f"{episode.path.parent}: no frame of {view} can be decoded")
    while row < episode.rows:
        yield held
        row += 1


def _units(episode: Episode, view: str, last_ns: int) -> Iterator[EncodedFrame]:
    first_ns = episode.keyframes_ns[view]
    units = (unit for unit in read_video(episode.path, view) if unit.capture_ns >= first_ns)
    return takewhile(lambda unit: unit.capture_ns <= last_ns, units)
