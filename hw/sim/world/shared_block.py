"""The simulated rig's shared memory: one block for the world, one for the frames.

A helper that was killed and started again finds its block, and its readers keep theirs.
"""

from __future__ import annotations

import mmap

from tams_app.errors import DeviceError
from tams_app.runtime.shared_block import create_block, new_block_name, open_block, remove_block

__all__ = ["attach_block", "create_block", "new_memory_name", "remove_memory"]

_SUFFIXES = ("world", "frames")


def new_memory_name() -> str:
    """A name for the shared memory of one session that nobody else has."""
    return new_block_name()


def remove_memory(name: str) -> None:
    """Remove every block of `name`, also after its helpers were killed; may be called twice."""
    for suffix in _SUFFIXES:
        remove_block(f"{name}-{suffix}")


def attach_block(name: str, size: int) -> mmap.mmap:
    """The block `name` for reading; DeviceError when nobody has made it."""
    try:
        block = open_block(name)
    except FileNotFoundError as error:
        raise DeviceError(
            "the simulated rig shares no memory; start its processes before this one"
        ) from error
    if len(block) != size:
        block.close()
        raise DeviceError("the simulated rig's memory has another layout; restart the session")
    return block
