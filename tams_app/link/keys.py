"""The secrets that two computers share: a file for each, readable by its owner alone.

A key has a name, of the person or the computer that it is for. The operator's side has one key; the
robot's side accepts one, or each that lies in a folder. To take a key away is to delete its file
there: it is not accepted from the next look at the folder on.
"""

from __future__ import annotations

import base64
import binascii
import os
import re
import secrets
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path

from tams_app.errors import ConfigError

KEY_BYTES = 32
IDENTITY_BYTES = 8
_MARK = "tams-key-2"
_SUFFIX = ".key"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,31}")
_LONGEST_FILE_BYTES = 1000


@dataclass(frozen=True, slots=True)
class Key:
    """A shared secret, and what is made of it. `name`: whose it is."""

    name: str
    secret: bytes = field(repr=False)  # shape (32,)
    identity: bytes = field(init=False, repr=False)  # by which initiations name it: no secret
    mac_key: bytes = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for attribute, person, size in (
            ("identity", b"TAMS key name", IDENTITY_BYTES),
            ("mac_key", b"TAMS key mac", KEY_BYTES),
        ):
            made = blake2b(key=self.secret, person=person, digest_size=size).digest()
            object.__setattr__(self, attribute, made)


# without a key file: no secret at all, for one computer only
LOOPBACK_KEY = Key("", bytes(KEY_BYTES))


def new_key(path: Path, name: str | None = None) -> Path:
    """Write a new random key; the file, mode 0600.

    `path`: the file, or a folder that gets one. `name`: whose it is; None: as the file is called.
    ConfigError if it exists, cannot be made, or the name is none.
    """
    if _is_folder(path):
        if name is None:
            raise ConfigError(f"{path}: is a folder; say whose key it is to get: --for NAME")
        path = path / f"{_valid(name)}{_SUFFIX}"
    name = _valid(path.stem if name is None else name)
    line = f"{_MARK} {name} {base64.b64encode(secrets.token_bytes(KEY_BYTES)).decode()}\n"
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
    return path


def revoke_key(folder: Path, name: str) -> Path:
    """Delete the key of that name; the file. ConfigError if the folder has none, or several."""
    found = [path for path in _key_files(folder) if _is_of(path, name)]
    if len(found) != 1:
        names = ", ".join(key.name for key in accepted_keys(folder)) or "none"
        raise ConfigError(f"{folder}: has no one key for {name!r}; it has: {names}")
    try:
        found[0].unlink()
    except OSError as error:
        raise ConfigError(f"{found[0]}: cannot be deleted ({error.strerror})") from error
    return found[0]


def read_key(path: Path) -> Key:
    """The key in `path`.

    ConfigError if it cannot be read, is no key, or if others than its owner may read it. No message
    says anything of what the file holds.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            content = file.read(_LONGEST_FILE_BYTES)
    except OSError as error:
        raise ConfigError(
            f"--key: {path}: cannot be read ({error.strerror}); name a file that key new FILE made"
        ) from error
    if stat.S_IMODE(mode) & 0o077:
        raise ConfigError(f"--key: {path}: others can read it; run: chmod 600 {path}")
    mark, _, rest = content.decode("ascii", "replace").strip().partition(" ")
    name, _, encoded = rest.partition(" ")
    try:
        secret = base64.b64decode(encoded, validate=True)
    except (binascii.Error, ValueError):
        secret = b""
    if mark != _MARK or len(secret) != KEY_BYTES or not _NAME.fullmatch(name):
        raise ConfigError(f"--key: {path}: holds no key of TAMS; make one with: key new FILE")
    return Key(name, secret)


def accepted_keys(path: Path) -> list[Key]:
    """The keys that the robot's side accepts: of a file, or of each `*.key` in a folder.

    ConfigError as of `read_key`; where there is none; where two have one name, which would not tell
    their owners apart.
    """
    keys = [read_key(one) for one in _key_files(path)]
    if not keys:
        raise ConfigError(f"--key: {path}: has no key; make one with: key new {path} --for NAME")
    names = [key.name for key in keys]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"--key: {path}: two keys are for {twice}; delete one")
    return keys


class AcceptedKeys:
    """The keys that the robot's side accepts, as its files stand; for a process that runs on."""

    def __init__(self, path: Path | None) -> None:
        """None: no secret, for one computer only. ConfigError as of `accepted_keys`."""
        self._path = path
        self._stamp = self._stamped()
        self.keys = _by_identity([LOOPBACK_KEY] if path is None else accepted_keys(path))

    def look(self) -> bool:
        """Look at the files again; whether `keys` is new. What cannot be read is not accepted."""
        stamp = self._stamped()
        if self._path is None or stamp == self._stamp:
            return False
        self._stamp = stamp
        keys = []
        for path in _key_files(self._path):
            try:
                keys.append(read_key(path))
            except ConfigError:
                continue  # half written, or open to others: the next look may find it whole
        self.keys = _by_identity(keys)
        return True

    def _stamped(self) -> list[tuple[object, ...]]:
        stamps: list[tuple[object, ...]] = []
        for path in [] if self._path is None else _key_files(self._path):
            try:
                at = path.stat()
            except OSError:
                stamps.append((path,))
            else:
                stamps.append((path, at.st_ino, at.st_size, at.st_mtime_ns, at.st_ctime_ns))
        return stamps


def _by_identity(keys: list[Key]) -> Mapping[bytes, Key]:
    return {key.identity: key for key in keys}


def _key_files(path: Path) -> list[Path]:
    """The files that may hold keys: of a folder those that `key new` makes there."""
    return sorted(path.glob(f"*{_SUFFIX}")) if _is_folder(path) else [path]


def _is_folder(path: Path) -> bool:
    """True if it is known to be one; what cannot be looked at is reported when it is read."""
    try:
        return path.is_dir()
    except OSError:
        return False


def _is_of(path: Path, name: str) -> bool:
    try:
        return read_key(path).name == name
    except ConfigError:
        return path.stem == name


def _valid(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"--for: {name!r} is no name: letters, digits, '.', '_' and '-', at most 32 of them"
        )
    return name
