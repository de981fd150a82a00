"""A Python program with its threads' names in the kernel too: `named_threads.py PROGRAM ...`.

Python tells the kernel from 3.14 on only, and without them processor time cannot be read by thread
from outside. Run it by its path, in the program's directory: packages are imported from there.
"""

import contextlib
import os
import runpy
import sys
import threading
from collections.abc import Callable
from pathlib import Path

LONGEST = 15  # characters; the kernel cuts what is longer


def name_in_kernel(start: Callable[[threading.Thread], None]) -> Callable[[threading.Thread], None]:
    """`threading.Thread.start`, and after it the thread's name told to the kernel."""

    def start_named(thread: threading.Thread) -> None:
        start(thread)
        with contextlib.suppress(OSError):  # it has ended already
            Path(f"/proc/self/task/{thread.native_id}/comm").write_text(thread.name[:LONGEST])

    return start_named


if __name__ == "__main__":
    threading.Thread.start = name_in_kernel(threading.Thread.start)  # type: ignore[assignment,method-assign]
    del sys.argv[0]
    sys.path[0] = os.getcwd()  # this file's directory otherwise
    runpy.run_path(sys.argv[0], run_name="__main__")
