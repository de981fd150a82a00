"""One side of two computers, started as a user starts it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tams_app.runtime.process import PROJECT_DIRECTORY


@contextmanager
def application(*words: str, space: str | None = None) -> Iterator[subprocess.Popen[str]]:
    """`run_tams.py` with these words, in the network namespace `space`; ended with the context."""
    inside = [] if space is None else ["ip", "netns", "exec", space]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [*inside, sys.executable, "run_tams.py", *words],
        cwd=PROJECT_DIRECTORY,
        stdin=subprocess.DEVNULL,
        stdout=pipe,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.terminate()
