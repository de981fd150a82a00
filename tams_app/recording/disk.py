"""The file under a recorder: never raises into the encoder, keeps its error, checks free space."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tams_app.errors import LogError

BYTES_PER_MB = 1_000_000
RESERVE_FRACTION = 0.1  # of the free space asked for at the start: below it recording ends


def free_mb(directory: Path) -> float:
    """Free space [MB] for an ordinary user on the disk of `directory`."""
    return shutil.disk_usage(directory).free / BYTES_PER_MB


def require_free_space(directory: Path, min_free_mb: float) -> None:
    """LogError if the disk of `directory` has less than `min_free_mb` [MB] free."""
    try:
        free = free_mb(directory)
    except OSError as error:
        raise LogError(
            f"{directory}: the log folder cannot be used: {error.strerror}; choose another"
        ) from error
    if free < min_free_mb:
        raise LogError(
            f"{directory}: only {free:.0f} MB are free, {min_free_mb:.0f} MB are wanted; "
            "delete old logs or lower recording.min_free_mb"
        )


class LogFile:
    """A new file in the shape the MCAP writers want: `write`, `seek`, `flush`, `tell`.

    An error of the disk is kept and what follows goes nowhere, so that the writer on top can be
    closed in good order; the owner asks `check`.
    Unbuffered on purpose: what was written survives a kill of this process, and os.write releases
    the GIL, so a slow disk never holds up the control loop.
    """

    def __init__(self, path: Path, min_free_mb: float = 0.0) -> None:
        """LogError if there is no folder, or less than `min_free_mb` [MB] free on its disk."""
        require_free_space(path.parent, min_free_mb)
        self.path = path
        self._reserve_mb = min_free_mb * RESERVE_FRACTION
        self._error: OSError | None = None
        self._size_bytes = 0
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise LogError(
                f"{path}: the log cannot be created: {error.strerror}; choose another folder"
            ) from error

    @property
    def size_bytes(self) -> int:
        """What was written whole; the disk is not asked."""
        return self._size_bytes

    def write(self, data: bytes | bytearray) -> int:
        """Write all of `data`."""
        view = memoryview(data)
        while view and self._error is None:
            try:
                view = view[self._file.write(view) :]
            except OSError as error:
                self._error = error
        if self._error is None:
            self._size_bytes += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        """Nothing is buffered."""

    def check(self) -> None:
        """LogError if anything could not be written."""
        if self._error is not None:
            raise LogError(
                f"{self.path}: the log cannot be written any more: {self._error.strerror}; "
                "what was written before is readable"
            )

    def check_space(self) -> None:
        """LogError if the disk was filled but for the reserve."""
        free = free_mb(self.path.parent)
        if free < self._reserve_mb:
            raise LogError(
                f"{self.path.parent}: recording ended because only {free:.0f} MB are free; "
                "delete old logs; what was written before is readable"
            )

    def close(self) -> None:
        """Close it; after an error what did not fit is cut off.

        Both writers hand over whole records, so whole ones stay.
        """
        if self._error is not None:
            self._file.truncate(self._size_bytes)
        self._file.close()
