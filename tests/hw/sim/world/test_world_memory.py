from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from hw.sim.world.shared_block import attach_block, create_block, new_memory_name, remove_memory
from hw.sim.world.truth import TruthReader
from hw.sim.world.world_memory import RigPace, WorldReader, WorldSnapshot, WorldWriter
from hw.sim.world.world_state import QPOS_SIZE, WorldState
from tams_app.errors import DeviceError

pytestmark = pytest.mark.untimed


@pytest.fixture
def name() -> Iterator[str]:
    name = new_memory_name()
    yield name
    remove_memory(name)


def snapshot(t_ns: int) -> WorldSnapshot:
    poses = np.arange(21.0).reshape(3, 7) + t_ns
    poses[:, 3:] = [0, 0, 0, 1]
    state = WorldState(np.arange(QPOS_SIZE) + float(t_ns), poses, 0.25, 0.016)
    return WorldSnapshot(t_ns, state, RigPace(cycles=t_ns, late=2, skipped=3))


def test_reader_gets_what_the_writer_published(name: str) -> None:
    writer = WorldWriter(name)
    reader = WorldReader(name)
    writer.publish(snapshot(7))
    got = reader.read()
    assert got is not None
    assert got.t_ns == 7
    assert got.pace == RigPace(7, 2, 3)
    assert (got.state.qpos == snapshot(7).state.qpos).all()
    assert (got.state.poses == snapshot(7).state.poses).all()
    truth = TruthReader(name)
    seen = truth.read()
    assert seen is not None
    assert seen.block.position.tolist() == [7, 8, 9]
    assert seen.tcp.position.tolist() == [21, 22, 23]
    assert (seen.block_speed, seen.fingers_opening) == (0.25, 0.016)
    assert truth.pace() == RigPace(7, 2, 3)
    for end in (truth, reader, writer):
        end.close()


def test_nothing_is_read_before_the_first_snapshot(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    assert reader.read() is None
    reader.close()
    writer.close()


@pytest.mark.parametrize("position", [0, 9, 16, 40, 200])
def test_torn_snapshot_gives_the_one_before(name: str, position: int) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    writer.publish(snapshot(1))
    writer.publish(snapshot(2))  # an even serial: it lies in the first slot
    size = reader._block.size()
    raw = create_block(f"{name}-world", size)
    raw[position] = raw[position] ^ 0x55
    got = reader.read()
    assert got is not None
    assert got.t_ns == 1
    raw.close()
    reader.close()
    writer.close()


def test_restarted_writer_is_seen_by_the_old_reader(name: str) -> None:
    first = WorldWriter(name)
    for t_ns in (1, 2, 3):
        first.publish(snapshot(t_ns))
    reader = WorldReader(name)
    first.close()
    second = WorldWriter(name)
    second.publish(snapshot(4))
    got = reader.read()
    assert got is not None
    assert got.t_ns == 4
    reader.close()
    second.close()


def test_missing_or_foreign_memory_is_one_sentence(name: str) -> None:
    with pytest.raises(DeviceError, match="start its processes"):
        WorldReader(name)
    create_block(f"{name}-world", 4096).close()
    with pytest.raises(DeviceError, match="restart the session"):
        WorldReader(name)


def test_removing_memory_leaves_readers_intact_and_may_be_repeated(name: str) -> None:
    writer, reader = WorldWriter(name), WorldReader(name)
    writer.publish(snapshot(5))
    remove_memory(name)
    remove_memory(name)
    got = reader.read()
    assert got is not None
    assert got.t_ns == 5
    reader.close()
    writer.close()
    with pytest.raises(DeviceError):
        attach_block(f"{name}-world", 4096)
