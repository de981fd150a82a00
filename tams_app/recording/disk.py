"""The file under a recorder: never raises into the encoder, keeps its error, checks free space."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import IO

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


def require_reserve(directory: Path, reserve_mb: float) -> None:
    """LogError if a log that is being written has filled the disk but for `reserve_mb` [MB]."""
    free = free_mb(directory)
    if free < reserve_mb:
        raise LogError(
            f"{directory}: recording ended because only {free:.0f} MB are free; "
            "delete old logs; what was written before is readable"
        )


class LogFile:
    """A new file in the shape the MCAP writers want: `write`, `seek`, `flush`, `tell`.

    An error of the disk is kept and what follows goes nowhere, so that the writer on top can be
    closed in good order; the owner asks `check`.
    Unbuffered on purpose: what was written survives a kill of this process, and os.write releases
    the GIL, so a slow disk never holds up the control loop.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._error: OSError | None = None
        self._complete_bytes = 0
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise LogError(
                f"{path}: the log cannot be created: {error.strerror}; choose another folder"
            ) from error

    def write(self, data: bytes | bytearray) -> int:
        """Write all of `data`."""
        if self._error is None:
            try:
                _write_all(self._file, data)
                self._complete_bytes += len(data)
            except OSError as error:
                self.fail(error)
        return len(data)

    def fail(self, error: OSError) -> None:
        """Something that belongs to the log could not be kept: what follows goes nowhere."""
        self._error = error

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

    def close(self) -> None:
        """Close it; after an error what did not fit is cut off.

        Both writers hand over whole records, so whole ones stay.
        """
        if self._error is not None:
            self._file.truncate(self._complete_bytes)
        self._file.close()


class ScratchFile:
    """Bytes that are wanted again once, on the disk of a log, in a file without a name."""

    def __init__(self, directory: Path) -> None:
        try:
            self._file = tempfile.TemporaryFile(dir=directory, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise LogError(
                f"{directory}: the log folder cannot be used: {error.strerror}; choose another"
            ) from error

    def write(self, data: bytes) -> None:
        """Write all of `data`; an OSError if the disk refuses."""
        _write_all(self._file, data)

    def read(self) -> bytes:
        """All that was written; an OSError if the disk refuses."""
        self._file.seek(0)
        return self._file.read()

    def close(self) -> None:
        """Let it go."""
        self._file.close()


def _write_all(file: IO[bytes], data: bytes | bytearray) -> None:
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]
