"""Memory shared by the processes of one host: a named file, mapped, in memory where there is one.

Not multiprocessing.shared_memory: its resource tracker unlinks blocks that others still use.
A block outlives the process that made it, so a helper that was killed and started again finds its
block, and its readers keep theirs. Whoever chose the name removes it in the end.
"""

from __future__ import annotations

import mmap
import os
import secrets
import tempfile
from pathlib import Path

from tams_app.errors import DeviceError

_SUFFIXES = ("world", "frames")


def new_memory_name() -> str:
    """A name for the shared memory of one session that nobody else has."""
    return f"tams-{os.getpid()}-{secrets.token_hex(6)}"


def remove_memory(name: str) -> None:
    """Remove every block of `name`, also after its helpers were killed; may be called twice."""
    for suffix in _SUFFIXES:
        _path(f"{name}-{suffix}").unlink(missing_ok=True)


def create_block(name: str, size: int) -> mmap.mmap:
    """The block `name` of `size` bytes for writing, zeroed unless it is there already."""
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(_path(name), flags, 0o600)
    try:
        if os.fstat(descriptor).st_size != size:
            os.ftruncate(descriptor, size)
        return mmap.mmap(descriptor, size)
    finally:
        os.close(descriptor)


def attach_block(name: str, size: int) -> mmap.mmap:
    """The block `name` for reading; DeviceError when nobody has made it."""
    try:
        descriptor = os.open(_path(name), os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError as error:
        raise DeviceError(
            "the simulated rig shares no memory; start its processes before this one"
        ) from error
    try:
        if os.fstat(descriptor).st_size != size:
            raise DeviceError("the simulated rig's memory has another layout; restart the session")
        return mmap.mmap(descriptor, size, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)


def _path(name: str) -> Path:
    memory = Path("/dev/shm")
    return (memory if memory.is_dir() else Path(tempfile.gettempdir())) / name
