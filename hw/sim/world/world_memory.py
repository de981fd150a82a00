"""The world's newest snapshot in shared memory: the rig writes, renderer and trial rules read.

Two slots are written in turn, each with its serial number and a checksum over all of it. A reader
takes the newer slot that is whole, so a torn snapshot is impossible to miss, on any processor, and
a writer killed half-way leaves the older one readable.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from hw.sim.world.shared_block import attach_block, create_block
from hw.sim.world.world_state import QPOS_SIZE, WorldState
from tams_app.records import SceneTruth

_HEADER = struct.Struct("<QI4x")  # serial (0: never written), CRC-32 of serial and body
_BODY = struct.Struct(f"<q{QPOS_SIZE}d21ddd3Q")
_SLOT_BYTES = _HEADER.size + _BODY.size
_SPEED = QPOS_SIZE + 21


@dataclass(frozen=True, slots=True)
class RigPace:
    """How well the rig keeps up with the wall clock."""

    cycles: int  # controller cycles run
    late: int  # of them, started more than one cycle after they were due
    skipped: int  # cycles left out because the rig had fallen too far behind


@dataclass(frozen=True, slots=True)
class WorldSnapshot:
    """The world at the simulated instant `t_ns`."""

    t_ns: int
    state: WorldState
    pace: RigPace

    @property
    def truth(self) -> SceneTruth:
        return self.state.truth(self.t_ns)


class WorldWriter:
    """Publishes snapshots under `memory_name`; one writer at a time."""

    def __init__(self, memory_name: str) -> None:
        self._block = create_block(f"{memory_name}-world", 2 * _SLOT_BYTES)
        self._serial = max(int(_HEADER.unpack_from(self._block, at)[0]) for at in (0, _SLOT_BYTES))

    def publish(self, snapshot: WorldSnapshot) -> None:
        """Put `snapshot` in place of the older of the two."""
        state, pace = snapshot.state, snapshot.pace
        body = _BODY.pack(
            snapshot.t_ns,
            *state.qpos.tolist(),
            *state.poses.ravel().tolist(),
            state.block_speed,
            state.fingers_opening,
            pace.cycles,
            pace.late,
            pace.skipped,
        )
        self._serial += 1
        start = (self._serial % 2) * _SLOT_BYTES
        header = _HEADER.pack(self._serial, _checksum(self._serial, body))
        self._block[start : start + _SLOT_BYTES] = header + body

    def close(self) -> None:
        self._block.close()


class WorldReader:
    """Reads the newest snapshot under `memory_name`; DeviceError when the rig never started."""

    def __init__(self, memory_name: str) -> None:
        self._block = attach_block(f"{memory_name}-world", 2 * _SLOT_BYTES)

    def read(self) -> WorldSnapshot | None:
        """The newest whole snapshot, None before the first."""
        slots = [self._block[at : at + _SLOT_BYTES] for at in (0, _SLOT_BYTES)]
        for slot in sorted(slots, key=lambda slot: -int(_HEADER.unpack_from(slot)[0])):
            serial, checksum = _HEADER.unpack_from(slot)
            body = slot[_HEADER.size :]
            if serial and checksum == _checksum(serial, body):
                return _snapshot(body)
        return None

    def close(self) -> None:
        self._block.close()


def _checksum(serial: int, body: bytes) -> int:
    return zlib.crc32(body, serial & 0xFFFFFFFF)


def _snapshot(body: bytes) -> WorldSnapshot:
    t_ns, *values = _BODY.unpack(body)
    poses = np.array(values[QPOS_SIZE:_SPEED]).reshape(3, 7)
    block_speed, opening, cycles, late, skipped = values[_SPEED:]
    state = WorldState(np.array(values[:QPOS_SIZE]), poses, block_speed, opening)
    return WorldSnapshot(t_ns, state, RigPace(cycles, late, skipped))
