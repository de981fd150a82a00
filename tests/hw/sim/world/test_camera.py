from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from hw.sim.world.camera import SimCamera
from hw.sim.world.rig_memory import (
    SLOTS,
    FrameGrid,
    FrameReader,
    FrameShape,
    FrameWriter,
    remove_memory,
)
from tams_app.errors import DeviceError
from tams_app.records import Image
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

SHAPE = FrameShape(("eih", "gt"), 16, 8)
PERIOD_NS = 33_333_333


@pytest.fixture
def name() -> Iterator[str]:
    name = new_block_name()
    yield name
    remove_memory(name)


@pytest.fixture
def writer(name: str) -> Iterator[FrameWriter]:
    writer = FrameWriter(name, SHAPE)
    yield writer
    writer.close()


def grey(value: int) -> Image:
    return np.full((SHAPE.height, SHAPE.width, 3), value, np.uint8)


class PlayedClock(VirtualClock):
    """A virtual clock at whose instants things happen; counts how often it was slept on."""

    def __init__(self) -> None:
        super().__init__()
        self.events: list[tuple[int, Callable[[], None]]] = []
        self.sleeps = 0

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.sleeps += 1
        super().sleep_until_ns(deadline_ns)
        for event in [event for event in self.events if event[0] <= self.now_ns()]:
            self.events.remove(event)
            event[1]()


def camera_at(name: str, clock: VirtualClock) -> SimCamera:
    camera = SimCamera("gt", name, clock, SHAPE)
    camera.start()
    return camera


def test_newest_frame_is_delivered_once_and_older_ones_are_skipped(
    name: str, writer: FrameWriter
) -> None:
    camera = camera_at(name, VirtualClock())
    for index in range(3):
        writer.publish("gt", index, 100 + index, grey(index))
    frame = camera.next_frame(0.1)
    assert frame is not None
    assert (frame.view, frame.index, frame.capture_ns) == ("gt", 2, 102)
    assert (frame.image == 2).all()
    assert camera.next_frame(0.1) is None
    camera.close()


def test_stalled_renderer_gives_none_after_the_timeout(name: str, writer: FrameWriter) -> None:
    clock = VirtualClock()
    camera = camera_at(name, clock)
    start_ns = clock.now_ns()
    assert camera.next_frame(0.25) is None
    assert clock.now_ns() - start_ns == 250 * NS_PER_MS
    camera.close()


def test_image_belongs_to_the_caller(name: str, writer: FrameWriter) -> None:
    camera = camera_at(name, VirtualClock())
    writer.publish("gt", 0, 1, grey(10))
    frame = camera.next_frame(0.1)
    assert frame is not None
    for index in range(1, SLOTS + 1):
        writer.publish("gt", index, 1, grey(99))
    assert (frame.image == 10).all()
    frame.image[:] = 3
    camera.close()


def test_waiting_is_mostly_sleeping_and_frames_come_at_once(name: str, writer: FrameWriter) -> None:
    clock = PlayedClock()
    start_ns = clock.now_ns()
    delay_ns = 7 * NS_PER_MS
    grid = FrameGrid(start_ns, PERIOD_NS)
    for index in range(30):
        instant_ns = start_ns + index * PERIOD_NS
        event = lambda n=index, t=instant_ns: writer.publish("gt", n, t, grey(n), grid)  # noqa: E731
        clock.events.append((instant_ns + delay_ns, event))
    camera = camera_at(name, clock)
    for index in range(30):
        if index == 15:
            clock.sleeps = 0
        frame = camera.next_frame(1.0)
        assert frame is not None
        assert frame.index == index
        if index >= 15:
            assert clock.now_ns() - frame.capture_ns <= delay_ns + NS_PER_MS
    assert clock.sleeps <= 15 * 5
    camera.close()


def test_frame_being_written_is_never_delivered(name: str, writer: FrameWriter) -> None:
    reader = FrameReader(name, "gt", SHAPE)
    for index in range(SLOTS):
        writer.publish("gt", index, 1, grey(10))
    during = []
    writer._rings["gt"].put(bytes(32), lambda _pixels: during.append(reader.newest()))
    assert [(frame.index, (frame.image == 10).all()) for frame in during if frame] == [(3, True)]
    reader.close()


def test_views_do_not_disturb_each_other(name: str, writer: FrameWriter) -> None:
    eih, gt = FrameReader(name, "eih", SHAPE), FrameReader(name, "gt", SHAPE)
    for index in range(SLOTS + 2):
        writer.publish("eih", index, index, grey(200))
    writer.publish("gt", 9, 5, grey(7))
    first, second = eih.newest(), gt.newest()
    assert first is not None
    assert second is not None
    assert (first.index, second.index) == (SLOTS + 1, 9)
    assert (first.image == 200).all()
    assert (second.image == 7).all()
    eih.close()
    gt.close()


def test_unknown_view_missing_renderer_and_unstarted_camera_are_device_errors(name: str) -> None:
    with pytest.raises(DeviceError, match="no camera 'left'"):
        SimCamera("left", name, VirtualClock()).start()
    camera = SimCamera("gt", name, VirtualClock())
    with pytest.raises(DeviceError, match="start its processes"):
        camera.start()
    with pytest.raises(DeviceError, match="not started"):
        camera.next_frame(0.1)
    camera.close()
    camera.close()
