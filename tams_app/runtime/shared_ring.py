"""Ring of records in memory that processes share: one writer that never waits, any readers.

A record is a small head and, where the ring has them, a bulk of pixels. Heads and bulks may be kept
for different lengths: a reader that falls behind still learns of every record, though perhaps not
what it held. A head carries a checksum over itself and its number; a bulk lies behind a serial
number that is odd while it is being written. Both are checked after the copy, so a record that is
being overwritten, or that a killed writer left half done, is never delivered.
"""

from __future__ import annotations

import errno
import mmap
import os
import secrets
import struct
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tams_app.errors import SetupError

if TYPE_CHECKING:  # numpy is loaded where it is used: the guard starts without it
    import numpy as np
    from numpy.typing import NDArray

    from tams_app.runtime import futex

_NUMBER = struct.Struct("<Q")  # of records put; of a bulk: 2n + 1 while n is written, then 2n + 2
_CHECKSUM = struct.Struct("<I4x")
_ALIGNED_BYTES = 64

Bulk: TypeAlias = "NDArray[np.uint8]"


@dataclass(frozen=True, slots=True)
class RingShape:
    """Size and number of a ring's heads and bulks; writer and readers must agree on it."""

    head_bytes: int
    heads: int
    bulk_bytes: int = 0
    bulks: int = 0

    @property
    def bulks_start(self) -> int:
        """Offset of the first bulk from the ring's start [bytes]."""
        return _aligned(_ALIGNED_BYTES + self.heads * (_CHECKSUM.size + self.head_bytes))

    @property
    def size(self) -> int:
        """Bytes that the whole ring takes."""
        return self.bulks_start + self.bulks * (_ALIGNED_BYTES + _aligned(self.bulk_bytes))


class SharedRing:
    """The ring of `shape` that begins at byte `start` of `memory`.

    Zeroed memory is an empty ring; what an earlier writer left is carried on.
    """

    def __init__(self, memory: mmap.mmap, shape: RingShape, start: int = 0) -> None:
        self._memory = memory
        self._shape = shape
        self._start = start

    def written(self) -> int:
        """The number of records put so far; they are numbered from 0."""
        return int(_NUMBER.unpack_from(self._memory, self._start)[0])

    def put(self, head: bytes, fill: Callable[[Bulk], object] | None = None) -> None:
        """Put the next record in place of the oldest.

        Args:
            head: `head_bytes` bytes.
            fill: Writes the bulk into the array it is given, uint8, shape (bulk_bytes,), and keeps
                no reference to it. None in a ring without bulks.
        """
        number = self.written()
        if fill is not None:
            at = self._bulk_at(number)
            _NUMBER.pack_into(self._memory, at, 2 * number + 1)
            fill(self._bulk_place(at))
            _NUMBER.pack_into(self._memory, at, 2 * number + 2)
        at = self._head_at(number)
        whole = _CHECKSUM.pack(_checksum(number, head)) + head
        self._memory[at : at + len(whole)] = whole
        _NUMBER.pack_into(self._memory, self._start, number + 1)

    def wake_readers(self) -> None:
        """Let those go on that wait for a record: after a `put`, if the ring has such readers."""
        from tams_app.runtime import futex

        futex.wake(self._count())

    def await_more(self, written: int, timeout_ns: int) -> None:
        """Sleep while no more than `written` records were put; it may return early, look again."""
        from tams_app.runtime import futex

        futex.wait(self._count(), written & 0xFFFFFFFF, timeout_ns)

    def head(self, number: int) -> bytes | None:
        """The head of record `number`; None if it is not there (any more)."""
        at = self._head_at(number)
        copy = self._memory[at : at + _CHECKSUM.size + self._shape.head_bytes]
        (checksum,), head = _CHECKSUM.unpack_from(copy), copy[_CHECKSUM.size :]
        return head if checksum == _checksum(number, head) else None

    def bulk(self, number: int, read: Callable[[Bulk], Bulk] | None = None) -> Bulk | None:
        """The result of `read` on the bulk of record `number`; None if it is not there (any more).

        `read` keeps no reference to what it is given; by default it copies it.
        """
        at, serial = self._bulk_at(number), 2 * number + 2
        if _NUMBER.unpack_from(self._memory, at)[0] != serial:
            return None
        place = self._bulk_place(at)
        made = place.copy() if read is None else read(place)
        return made if _NUMBER.unpack_from(self._memory, at)[0] == serial else None

    def newest(self) -> tuple[int, bytes] | None:
        """Number and head of the newest record that is whole; None if there is none."""
        written = self.written()
        for number in range(written - 1, max(-1, written - 1 - self._shape.heads), -1):
            head = self.head(number)
            if head is not None:
                return number, head
        return None

    def _count(self) -> futex.Word:
        """The lower half of the number of records; the machines that have a futex put it first."""
        import numpy as np

        return np.frombuffer(self._memory, np.uint32, 1, self._start)

    def _head_at(self, number: int) -> int:
        slot = number % self._shape.heads
        return self._start + _ALIGNED_BYTES + slot * (_CHECKSUM.size + self._shape.head_bytes)

    def _bulk_at(self, number: int) -> int:
        slot, shape = number % self._shape.bulks, self._shape
        slot_bytes = _ALIGNED_BYTES + _aligned(shape.bulk_bytes)
        return self._start + shape.bulks_start + slot * slot_bytes

    def _bulk_place(self, at: int) -> Bulk:
        import numpy as np

        return np.frombuffer(self._memory, np.uint8, self._shape.bulk_bytes, at + _ALIGNED_BYTES)


def _aligned(size: int) -> int:
    return -(-size // _ALIGNED_BYTES) * _ALIGNED_BYTES


def _checksum(number: int, head: bytes) -> int:
    return zlib.crc32(head, number & 0xFFFFFFFF)


def new_block_name() -> str:
    """A unique name for a session's shared memory."""
    return f"tams-{os.getpid()}-{secrets.token_hex(6)}"


def create_block(name: str, size: int) -> mmap.mmap:
    """The block `name` of `size` bytes for writing, zeroed unless it is there already.

    Raises SetupError if it does not fit: memory that was only promised would end the process by
    SIGBUS at the first write beyond what there is.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(_path(name), flags, 0o600)
    try:
        if os.fstat(descriptor).st_size != size:
            os.ftruncate(descriptor, size)
        os.posix_fallocate(descriptor, 0, size)  # also of a maker that was killed before it did
        return mmap.mmap(descriptor, size)
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        remove_block(name)
        raise SetupError(too_small(size)) from error
    finally:
        os.close(descriptor)


def require_room(size: int) -> None:
    """SetupError if blocks of `size` bytes, all together, have no room."""
    found = os.statvfs(_folder())
    if found.f_bavail * found.f_frsize < size:
        raise SetupError(too_small(size))


def too_small(size: int) -> str:
    """The sentence for shared memory that has no room for `size` bytes more."""
    return (
        f"{_folder()} has no room for {-(-size // 1_000_000)} MB of shared memory: make it larger "
        f"(mount -o remount,size=256m {_folder()}; in a container: --shm-size=256m)"
    )


def open_block(name: str) -> mmap.mmap:
    """The block `name` for reading, whole; FileNotFoundError when it does not exist."""
    return map_descriptor(open_descriptor(name))


def open_descriptor(name: str) -> int:
    """A descriptor of the block `name` for reading, which outlives the name; close it."""
    return os.open(_path(name), os.O_RDONLY | os.O_CLOEXEC)


def map_descriptor(descriptor: int) -> mmap.mmap:
    """The block behind `descriptor` for reading, whole; closes the descriptor."""
    try:
        return mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)


def remove_block(name: str) -> None:
    """Take the name away; processes that have the block mapped keep it. May be called twice."""
    _path(name).unlink(missing_ok=True)


def _path(name: str) -> Path:
    return _folder() / name


def _folder() -> Path:
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())
