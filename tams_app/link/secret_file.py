"""A file of one line that its owner alone may read and that is never overwritten."""

from __future__ import annotations

import base64
import os
import stat
from pathlib import Path

from tams_app.errors import ConfigError

_LONGEST_FILE_BYTES = 1000


def write_secret(path: Path, line: str) -> None:
    """Make the file, mode 0600; ConfigError if it is there or cannot be written."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise ConfigError(
            f"{path}: is there already; give another name, or delete it if no computer needs it"
        ) from error
    except OSError as error:
        raise _cannot_be_written(path, error) from error
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(descriptor)
    except OSError as error:
        path.unlink(missing_ok=True)  # half of it would only be in the way
        raise _cannot_be_written(path, error) from error


def read_secret(path: Path, what_to_name: str) -> str:
    """The file's text; ConfigError if it cannot be read, or if others than its owner may read it.

    `what_to_name`: instead of a file that cannot be read. No message tells what the file holds.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            content = file.read(_LONGEST_FILE_BYTES)
    except OSError as error:
        raise ConfigError(
            f"--key: {path}: cannot be read ({error.strerror}); name {what_to_name}"
        ) from error
    if stat.S_IMODE(mode) & 0o077:
        raise ConfigError(f"--key: {path}: others can read it; run: chmod 600 {path}")
    return content.decode("ascii", "replace").strip()


def encoded(value: bytes) -> str:
    """A value as a word of such a line (Base64)."""
    return base64.b64encode(value).decode()


def decoded(word: str) -> bytes:
    """The value of such a word; empty for what is none."""
    try:
        return base64.b64decode(word, validate=True)
    except ValueError:
        return b""


def is_folder(path: Path) -> bool:
    """True if it is known to be one; what cannot be looked at is reported when it is read."""
    try:
        return path.is_dir()
    except OSError:
        return False


def _cannot_be_written(path: Path, error: OSError) -> ConfigError:
    return ConfigError(f"{path}: cannot be written ({error.strerror}); name another place")
