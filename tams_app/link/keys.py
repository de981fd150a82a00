"""The secret that both computers share: a file of its own, readable by its owner alone."""

from __future__ import annotations

import base64
import binascii
import os
import secrets
import stat
from pathlib import Path

from tams_app.errors import ConfigError

KEY_BYTES = 32
LOOPBACK_KEY = bytes(KEY_BYTES)  # without a key file: no secret at all, for one computer only
_MARK = "tams-key-1"


def new_key(path: Path) -> None:
    """Write a new random key to `path`, mode 0600; ConfigError if it exists or cannot be made."""
    line = f"{_MARK} {base64.b64encode(secrets.token_bytes(KEY_BYTES)).decode()}\n"
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise ConfigError(
            f"{path}: is there already; give another name, or delete it if no computer needs it"
        ) from error
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be written ({error.strerror}); name another place"
        ) from error
    with os.fdopen(descriptor, "w") as file:
        file.write(line)


def read_key(path: Path) -> bytes:
    """The key in `path`, 32 bytes.

    ConfigError if it cannot be read, is no key, or if others than its owner may read it. No message
    says anything of what the file holds.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            content = file.read(1000)
    except OSError as error:
        raise ConfigError(
            f"--key: {path}: cannot be read ({error.strerror}); name a file that key new FILE made"
        ) from error
    if stat.S_IMODE(mode) & 0o077:
        raise ConfigError(f"--key: {path}: others can read it; run: chmod 600 {path}")
    mark, _, encoded = content.decode("ascii", "replace").strip().partition(" ")
    try:
        key = base64.b64decode(encoded, validate=True)
    except (binascii.Error, ValueError):
        key = b""
    if mark != _MARK or len(key) != KEY_BYTES:
        raise ConfigError(f"--key: {path}: holds no key of TAMS; make one with: key new FILE")
    return key
