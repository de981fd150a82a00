"""Sleep until another process has changed a word of memory that both share (Linux, futex(2)).

Nothing has to be opened, inherited or cleaned up: the word itself is what is waited on, so a writer
that was killed and one that takes its place wake the same readers.
"""

from __future__ import annotations

import ctypes
import platform
import sys
import time

import numpy as np
from numpy.typing import NDArray

from tams_app.units import NS_PER_S

Word = NDArray[np.uint32]

_SYSTEM_CALLS = {"x86_64": 202, "aarch64": 98}
_CALL = _SYSTEM_CALLS.get(platform.machine()) if sys.platform == "linux" else None
_WAIT, _WAKE = 0, 1
_EVERYBODY = 0x7FFFFFFF
_POLL_S = 0.001  # where there is no futex
_LIBRARY = ctypes.CDLL(None)


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def wait(word: Word, seen: int, timeout_ns: int) -> None:
    """Sleep until `wake` is called on `word`, shape (1,), or `timeout_ns` have passed.

    Returns at once if it no longer holds `seen`, and may return early: look again.
    """
    if timeout_ns <= 0:
        return
    if _CALL is None:
        time.sleep(min(_POLL_S, timeout_ns / NS_PER_S))
        return
    timeout = _Timespec(*divmod(timeout_ns, NS_PER_S))
    _LIBRARY.syscall(
        ctypes.c_long(_CALL),
        ctypes.c_void_p(word.ctypes.data),
        ctypes.c_int(_WAIT),
        ctypes.c_uint32(seen),
        ctypes.byref(timeout),
        None,
        ctypes.c_int(0),
    )


def wake(word: Word) -> None:
    """Wake all that wait on `word`, shape (1,), in any process."""
    if _CALL is not None:
        _LIBRARY.syscall(
            ctypes.c_long(_CALL),
            ctypes.c_void_p(word.ctypes.data),
            ctypes.c_int(_WAKE),
            ctypes.c_int(_EVERYBODY),
            None,
            None,
            ctypes.c_int(0),
        )
