from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from hw.sim.layout import HEIGHT_PX, WIDTH_PX
from hw.sim.world.rig_memory import SLOTS, FrameWriter, RigFrameReader, SimCamera
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock

pytestmark = pytest.mark.waiting

PATIENCE_S = 10.0


def grey(value: int) -> Image:
    return np.full((HEIGHT_PX, WIDTH_PX, 3), value, np.uint8)


@pytest.fixture
def camera(name: str, writer: FrameWriter) -> Iterator[SimCamera]:
    camera = SimCamera("gt", name, MonotonicClock())
    camera.start()
    yield camera
    camera.close()


@contextmanager
def meanwhile(do: Callable[[], None]) -> Iterator[None]:
    """`do` in another thread, a moment later."""
    thread = threading.Timer(0.05, do)
    thread.start()
    try:
        yield
    finally:
        thread.join()


def test_a_frame_tells_when_it_was_taken_and_when_it_was_rendered(
    writer: FrameWriter, camera: SimCamera
) -> None:
    writer.publish("gt", 4, 1000, grey(7), ready_ns=1500)
    frame = camera.next_frame(1.0)
    assert frame is not None
    assert (frame.index, frame.capture_ns, frame.ready_ns) == (4, 1000, 1500)


def test_a_camera_that_waits_sleeps_until_a_frame_is_published(
    writer: FrameWriter, camera: SimCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []
    written = RigFrameReader.written
    monkeypatch.setattr(RigFrameReader, "written", lambda self: looks.append(None) or written(self))
    started_s = time.monotonic()
    with meanwhile(lambda: writer.publish("gt", 0, 1, grey(10))):
        frame = camera.next_frame(PATIENCE_S)
    assert time.monotonic() - started_s < PATIENCE_S
    assert frame is not None
    assert frame.index == 0
    assert len(looks) <= 3  # before, after, and once between at most


def test_a_camera_that_waits_is_woken_by_a_renderer_that_has_taken_the_place_of_another(
    name: str, writer: FrameWriter, camera: SimCamera
) -> None:
    writer.publish("gt", 0, 1, grey(10))
    assert camera.next_frame(PATIENCE_S) is not None
    other = FrameWriter(name)
    started_s = time.monotonic()
    with meanwhile(lambda: other.publish("gt", 1, 2, grey(20))):
        frame = camera.next_frame(PATIENCE_S)
    other.close()
    assert time.monotonic() - started_s < PATIENCE_S
    assert frame is not None
    assert frame.index == 1


def test_frame_being_written_is_never_delivered(name: str, writer: FrameWriter) -> None:
    reader = RigFrameReader(name, "gt")
    for index in range(SLOTS):
        writer.publish("gt", index, 1, grey(10))
    during = []
    writer._rings["gt"].put(bytes(32), lambda _pixels: during.append(reader.newest()))
    assert [(frame.index, (frame.image == 10).all()) for frame in during if frame] == [(3, True)]
    reader.close()
