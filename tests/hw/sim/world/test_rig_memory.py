from __future__ import annotations

import pytest

from hw.sim.world.rig_memory import (
    QPOS_SIZE,
    RigFrameReader,
    WorldReader,
    WorldState,
    WorldWriter,
    remove_memory,
)
from tams_app.errors import DeviceError
from tams_app.runtime.shared_ring import create_block

pytestmark = pytest.mark.untimed


def state(t_ns: int) -> WorldState:
    poses = tuple((at, at + 1.0, at + 2.0, 0.0, 0.0, 0.0, 1.0) for at in (7.0, 14.0, 21.0))
    return WorldState(tuple(float(t_ns + at) for at in range(QPOS_SIZE)), poses, 0.25, 0.016)


def test_reader_gets_what_the_writer_published(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    writer.publish(7, state(7))
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


def test_nothing_is_read_before_the_first_state(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    assert reader.read() is None
    assert reader.truth() is None
    reader.close()
    writer.close()


def test_missing_or_foreign_memory_is_one_sentence(name: str) -> None:
    with pytest.raises(DeviceError, match="start its processes"):
        WorldReader(name)
    with pytest.raises(DeviceError, match="start its processes"):
        RigFrameReader(name, "gt")
    create_block(f"{name}-world", 4096).close()
    with pytest.raises(DeviceError, match="restart the session"):
        WorldReader(name)


def test_removing_memory_leaves_readers_intact_and_may_be_repeated(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    writer.publish(5, state(5))
    remove_memory(name)
    remove_memory(name)
    newest = reader.read()
    assert newest is not None
    assert newest[0] == 5
    reader.close()
    writer.close()
    with pytest.raises(DeviceError):
        WorldReader(name)
