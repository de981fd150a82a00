"""The renderer of the simulated cameras, a helper process below everything real-time.

Specification: memory_name, seed, fps. Ready facts: none. Each view has a time grid, a third
of a period apart from the next view's; an instant that is missed is a gap in the index. After each
frame it rests half as long as that took: where cores are short, the control loop is not late.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import cv2

from hw.sim.layout import VIEWS, draw_layout
from hw.sim.world.rig_memory import FrameWriter, WorldReader
from hw.sim.world.scene_renderer import CameraImages, stagger_ns
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import RENDERER_NICE, use_nice
from tams_app.units import NS_PER_MS, NS_PER_S

_NICE_OTHERWISE = 10  # where no better scheduling is permitted: below what keeps time
_START_DELAY_NS = 50 * NS_PER_MS
_STALE_NS = 200 * NS_PER_MS  # a world that has stopped has cameras that have stopped
_POLL_NS = 20 * NS_PER_MS


@dataclass(slots=True)
class _Camera:
    """One view's place in time: number and instant of its next frame."""

    view: str
    due_ns: int
    period_ns: int
    next_index: int = 0
    taken_ns: int = 0  # instant of the last frame

    def drop_missed(self, now_ns: int) -> None:
        """Leave out the instants that a later one has followed."""
        self._skip(max(0, (now_ns - self.due_ns) // self.period_ns))

    def taken(self) -> None:
        """Go on to the next instant."""
        self.taken_ns = self.due_ns
        self._skip(1)

    def _skip(self, frames: int) -> None:
        self.next_index += frames
        self.due_ns += frames * self.period_ns


class CameraSchedule:
    """The order of the views: where there is no time for all they take turns.

    So none misses more frames than another.
    """

    def __init__(self, fps: float, now_ns: int) -> None:
        period_ns = round(NS_PER_S / fps)
        first_ns = now_ns + _START_DELAY_NS
        self._cameras = [
            _Camera(view, first_ns + stagger_ns(view, period_ns), period_ns) for view in VIEWS
        ]

    def next(self, now_ns: int) -> _Camera:
        """Of the cameras that are due the one that waits longest, else the one due first.

        Instants that a later one has followed are left out.
        """
        for camera in self._cameras:
            camera.drop_missed(now_ns)
        due = [camera for camera in self._cameras if camera.due_ns <= now_ns]
        if due:
            return min(due, key=attrgetter("taken_ns", "due_ns"))
        return min(self._cameras, key=attrgetter("due_ns"))


def run(
    frames: CameraImages,
    world: WorldReader,
    writer: FrameWriter,
    fps: float,
    clock: Clock,
    stop: threading.Event,
) -> None:
    """Render each view at its instants, at most `fps` a second, until `stop` is set."""
    schedule = CameraSchedule(fps, clock.now_ns())
    while not stop.is_set():
        camera = schedule.next(clock.now_ns())
        clock.sleep_until_ns(camera.due_ns)
        newest = world.read()
        if newest is None or clock.now_ns() - newest[0] > _STALE_NS:
            clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
            continue
        (t_ns, state), began_ns = newest, clock.now_ns()
        image = frames.take(camera.view, camera.next_index, state.qpos)
        writer.publish(camera.view, camera.next_index, t_ns, image, clock.now_ns())
        camera.taken()
        ended_ns = clock.now_ns()
        clock.sleep_until_ns(ended_ns + (ended_ns - began_ns) // 2)


def main() -> None:
    side = HelperSide()
    use_nice(RENDERER_NICE, _NICE_OTHERWISE)
    with side.failing():
        _serve(side, side.specification)


def _serve(side: HelperSide, specification: dict[str, Any]) -> None:
    name, seed = str(specification["memory_name"]), int(specification["seed"])
    clock = MonotonicClock()
    cv2.setNumThreads(1)  # the rows of an image are too few for threads that wait by spinning

    world = WorldReader(name)
    frames = CameraImages(draw_layout(seed), seed)
    writer = FrameWriter(name)
    try:
        side.ready()
        while not side.stop_requested.is_set() and world.read() is None:
            clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
        run(frames, world, writer, float(specification["fps"]), clock, side.stop_requested)
    finally:
        frames.close()
        writer.close()
        world.close()


if __name__ == "__main__":
    main()
