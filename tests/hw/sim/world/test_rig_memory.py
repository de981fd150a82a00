from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from hw.sim.layout import HEIGHT_PX, WIDTH_PX
from hw.sim.world.rig_memory import (
    QPOS_SIZE,
    FrameWriter,
    SimCamera,
    WorldReader,
    WorldState,
    WorldWriter,
    remove_memory,
)
from tams_app.errors import DeviceError
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.shared_ring import SharedRing, create_block

pytestmark = pytest.mark.waiting

PATIENCE_S = 10.0


def state(t_ns: int) -> WorldState:
    poses = tuple((at, at + 1.0, at + 2.0, 0.0, 0.0, 0.0, 1.0) for at in (7.0, 14.0, 21.0))
    return WorldState(tuple(float(t_ns + at) for at in range(QPOS_SIZE)), poses, 0.25, 0.016)


def test_what_was_published_is_read_also_once_the_name_is_gone(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    assert reader.read() is None
    assert reader.truth() is None
    writer.publish(7, state(7))
    remove_memory(name)
    remove_memory(name)
    newest = reader.read()
    assert newest is not None
    t_ns, got = newest
    assert t_ns == 7
    assert got.qpos == state(7).qpos
    assert got.poses == state(7).poses
    truth = reader.truth()
    assert truth is not None
    assert truth.t_ns == 7
    assert truth.block.position.tolist() == [7, 8, 9]
    assert truth.tcp.position.tolist() == [21, 22, 23]
    assert (truth.block_speed, truth.fingers_opening) == (0.25, 0.016)
    reader.close()
    writer.close()


def test_missing_or_foreign_memory_is_one_sentence(name: str) -> None:
    with pytest.raises(DeviceError, match="start its processes"):
        WorldReader(name)
    create_block(f"{name}-world", 4096).close()
    with pytest.raises(DeviceError, match="restart the session"):
        WorldReader(name)


def grey(value: int) -> Image:
    return np.full((HEIGHT_PX, WIDTH_PX, 3), value, np.uint8)


def test_a_camera_that_waits_sleeps_until_a_frame_is_published(
    name: str, writer: FrameWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, sleeps = SimCamera("gt", name, MonotonicClock()), []
    camera.start()
    await_more = SharedRing.await_more

    def sleep(ring: SharedRing, written: int, timeout_ns: int) -> None:
        sleeps.append(written)
        await_more(ring, written, timeout_ns)

    monkeypatch.setattr(SharedRing, "await_more", sleep)
    started_s = time.monotonic()
    renderer = threading.Timer(0.05, writer.publish, ("gt", 4, 1000, grey(7), 1500))
    renderer.start()
    frame = camera.next_frame(PATIENCE_S)
    renderer.join()
    assert time.monotonic() - started_s < PATIENCE_S
    assert frame is not None
    assert (frame.index, frame.capture_ns, frame.ready_ns) == (4, 1000, 1500)
    assert len(sleeps) <= 2  # futexes may wake early
    camera.close()
