"""Memory that a process keeps for its next images instead of giving it back.

An image is larger than what glibc's malloc keeps by itself: it gives the memory back at once, and
the next image of the same size gets new pages, which the kernel clears one by one. That takes
longer than most of what is then done with an image.
"""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # malloc.h
_KEPT_BYTES = 64 << 20  # free at the end of a heap, before it is given back
_LARGEST_KEPT_BYTES = 32 << 20  # of one block; malloc allows no more


def keep_freed_memory() -> None:
    """Keep what this process frees from now on, up to 64 MB a heap; only glibc knows how."""
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_TRIM_THRESHOLD, _KEPT_BYTES)
        set_option(_MMAP_THRESHOLD, _LARGEST_KEPT_BYTES)
