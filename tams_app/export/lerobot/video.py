"""An episode's frames of one view as an MP4 file in which every frame can be found exactly."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from itertools import takewhile
from pathlib import Path

import av

from tams_app.errors import LogError
from tams_app.export.lerobot.episode import EpisodeSource, unusable
from tams_app.export.lerobot.statistics import PixelStatistics
from tams_app.recording import read_video
from tams_app.video.core.codecs import Planes
from tams_app.video.live.codecs import decoded

# Constant quality, near to lossless beside what the uplink took. A learner reads frames in any
# order: for one it decodes ten at most. Without B frames the first has the time 0.
_PRESET = {"preset": "veryfast", "tune": "zerolatency", "profile": "high"}
_X264 = (
    "crf=20:keyint=10:bframes=0:threads=1:range=tv:"
    "colorprim=smpte170m:transfer=smpte170m:colormatrix=smpte170m"
)
_LOWEST_KBPS = 50
_BUFFER_S = 1.0  # over which the rate is held
_SHARE = 1.15  # of the log's own video: what a dataset's may be at most
_FRAMES_LOOKED_AT = 100  # for the statistics of pixels


def write_video(
    path: Path, episode: EpisodeSource, view: str
) -> Generator[None, None, PixelStatistics]:
    """Write the file at `path`, of which frame n is shown at n / fps; what its pixels are like.

    Yields after each. LogError if it cannot be written, UnreadableLogError if the view cannot be
    decoded.
    """
    shape, pixels = episode.shape, PixelStatistics()
    # what the encoder's buffer lets through beside the rate is part of the share
    kbit, seconds = _SHARE * episode.sizes_bytes[view] * 8 / 1000, episode.rows / shape.fps
    kbps = max(round(kbit / (seconds + _BUFFER_S)), _LOWEST_KBPS)
    x264 = f"{_X264}:vbv-maxrate={kbps}:vbv-bufsize={kbps * _BUFFER_S:.0f}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(path), "w") as file, closing(_frames_on_grid(episode, view)) as frames:
            stream = file.add_stream("libx264", shape.fps, _PRESET | {"x264-params": x264})
            stream.width, stream.height, stream.pix_fmt = shape.width, shape.height, "yuv420p"
            for row, planes in enumerate(frames):
                frame = av.VideoFrame.from_ndarray(planes.reshape(-1, shape.width), "yuv420p")
                frame.pts = row
                file.mux(stream.encode(frame))
                if row % -(-episode.rows // _FRAMES_LOOKED_AT) == 0:
                    pixels.add(planes, shape.height, shape.width)
                yield
            file.mux(stream.encode())
    except av.FFmpegError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror}") from error
    return pixels


def _frames_on_grid(episode: EpisodeSource, view: str) -> Generator[Planes]:
    """The newest frame captured at each instant of the episode's grid, as I420 planes."""
    width, height = episode.shape.width, episode.shape.height
    first_ns, last_ns = episode.keyframes_ns[view], episode.grid_ns[-1]
    units = (unit for unit in read_video(episode.path, view) if unit.capture_ns >= first_ns)
    held: Planes | None = None
    with closing(decoded(takewhile(lambda unit: unit.capture_ns <= last_ns, units))) as frames:
        following = next(frames, None)
        for instant_ns in episode.grid_ns:
            while following is not None and (held is None or following[0] <= instant_ns):
                held, following = following[1], next(frames, None)
                if held.size != width * height * 3 // 2:
                    what = f"the frames of {view} are not of {width}x{height}"
                    raise unusable(episode.path, f"{what} as its header says")
            if held is None:
                raise unusable(episode.path, f"no frame of {view} can be decoded")
            yield held
