"""The contract of every camera."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise

import numpy as np

from hw.camera import Camera
from tams_app.config import VideoConfig
from tams_app.records import Frame
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.units import NS_PER_S
from tests.contract.promises.promise import Promise, refused, require

_WITHIN_S = 5.0  # for a frame; generous: the machine may be busy
_FRAMES = 12
_GRID = 1.5  # periods between a frame's index and its capture time


class CameraBench(ABC):
    """A maker of cameras of one view."""

    view: str
    """The name that their frames must carry."""
    video: VideoConfig
    """Size [pixels] and rate [frames/s] that their frames must have."""
    clock: Clock = MonotonicClock()
    """The clock of their capture times."""

    @abstractmethod
    def camera(self) -> Camera:
        """A camera whose device is there, not started; the one before has been closed."""

    def frames(self, camera: Camera, count: int) -> list[Frame]:
        """The next `count` frames; AssertionError if one does not come within 5 s."""
        found = []
        for _ in range(count):
            frame = camera.next_frame(_WITHIN_S)
            require(frame is not None, f"no frame came within {_WITHIN_S:g} s")
            found += [] if frame is None else [frame]
        return found


@contextmanager
def _started(bench: CameraBench) -> Iterator[Camera]:
    with closing(bench.camera()) as camera:
        camera.start()
        yield camera


def frames_are_of_the_view_and_of_the_size_asked_for(bench: CameraBench) -> None:
    with _started(bench) as camera:
        (frame,) = bench.frames(camera, 1)
    shape = (bench.video.height, bench.video.width, 3)
    require(frame.view == bench.view, f"the view is {frame.view!r}, not {bench.view!r}")
    require(frame.image.shape == shape, f"the shape is {frame.image.shape}, not {shape}")
    require(frame.image.dtype == np.uint8, f"the type is {frame.image.dtype}, not uint8")


def indices_and_capture_times_only_grow(bench: CameraBench) -> None:
    with _started(bench) as camera:
        frames = bench.frames(camera, _FRAMES)
        now_ns = bench.clock.now_ns()
    for before, after in pairwise(frames):
        require(after.index > before.index, f"index {after.index} follows {before.index}")
        require(after.capture_ns > before.capture_ns, "a capture time follows a later one")
    require(frames[-1].capture_ns <= now_ns, "a frame was captured in the future")


def indices_are_places_on_a_fixed_grid(bench: CameraBench) -> None:
    with _started(bench) as camera:
        frames = bench.frames(camera, _FRAMES)
    places = [one.index - one.capture_ns * bench.video.fps / NS_PER_S for one in frames]
    off = max(places) - min(places)
    require(off <= _GRID, f"indices are {off:.1f} periods off their capture times")


def frames_not_read_are_skipped_and_leave_a_gap(bench: CameraBench) -> None:
    with _started(bench) as camera:
        (before,) = bench.frames(camera, 1)
        bench.clock.sleep_until_ns(bench.clock.now_ns() + NS_PER_S // 2)
        (after,) = bench.frames(camera, 1)
    periods = (after.capture_ns - before.capture_ns) * bench.video.fps / NS_PER_S
    require(periods > 5, f"half a second later a frame comes that is {periods:.1f} periods newer")
    gap = after.index - before.index
    require(abs(gap - periods) <= _GRID, f"the index grows by {gap} in {periods:.1f} periods")


def each_frame_is_the_callers_own(bench: CameraBench) -> None:
    with _started(bench) as camera:
        (frame,) = bench.frames(camera, 1)
        original = frame.image.copy()
        for other in bench.frames(camera, 6):
            require(not np.shares_memory(other.image, frame.image), "two frames share memory")
            other.image[:] = 0
    require(bool((frame.image == original).all()), "a frame changes after it was given")


def before_the_start_and_after_the_end_there_are_no_frames(bench: CameraBench) -> None:
    with closing(bench.camera()) as camera:
        refused(lambda: camera.next_frame(0.01))
        camera.start()
        camera.close()
    refused(lambda: camera.next_frame(0.01))


def a_closed_camera_can_be_opened_again(bench: CameraBench) -> None:
    for _ in range(2):
        with _started(bench) as camera:
            bench.frames(camera, 1)


CAMERA_PROMISES: tuple[Promise[CameraBench], ...] = (
    frames_are_of_the_view_and_of_the_size_asked_for,
    indices_and_capture_times_only_grow,
    indices_are_places_on_a_fixed_grid,
    frames_not_read_are_skipped_and_leave_a_gap,
    each_frame_is_the_callers_own,
    before_the_start_and_after_the_end_there_are_no_frames,
    a_closed_camera_can_be_opened_again,
)
