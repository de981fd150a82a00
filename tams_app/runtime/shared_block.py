"""Memory shared by the processes of one host: a named file, mapped, in memory where there is one.

Not multiprocessing.shared_memory: its resource tracker unlinks blocks that others still use.
A block outlives the process that made it: a process that is started again finds it as it was. The
process that chose the name removes it in the end.
"""

from __future__ import annotations

import mmap
import os
import secrets
import tempfile
from pathlib import Path


def new_block_name() -> str:
    """A new name for a session's shared memory."""
    return f"tams-{os.getpid()}-{secrets.token_hex(6)}"


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


def open_block(name: str) -> mmap.mmap:
    """The block `name` for reading, whole; FileNotFoundError before it is made."""
    descriptor = os.open(_path(name), os.O_RDONLY | os.O_CLOEXEC)
    try:
        return mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)


def remove_block(name: str) -> None:
    """Take the name away; who has the block mapped keeps it. May be called twice."""
    _path(name).unlink(missing_ok=True)


def _path(name: str) -> Path:
    memory = Path("/dev/shm")
    return (memory if memory.is_dir() else Path(tempfile.gettempdir())) / name
