"""The secrets that two computers share: a file for each, readable by its owner alone.

A key has a name, of the person or the computer that it is for, and tells the robot that it is for.
The operator's side has one key; the robot's side accepts one, or each that lies in a folder, and
has its identity beside them. To take a key away is to delete its file there: it is not accepted
from the next look at the folder on.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path

from tams_app.errors import ConfigError
from tams_app.link.identity import (
    IDENTITY_MARK,
    PUBLIC_BYTES,
    RobotIdentity,
    identity_for_new_keys,
    read_identity,
)
from tams_app.link.secret_file import decoded, encoded, is_folder, read_secret, write_secret

KEY_BYTES = 32
IDENTITY_BYTES = 8
_MARK = "tams-key-3"
_MARK_WITHOUT_ROBOT = "tams-key-2"  # of version 3 of TAMS
_SUFFIX = ".key"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,31}")


@dataclass(frozen=True, slots=True)
class Key:
    """A shared secret, and what is made of it. `name`: whose it is."""

    name: str
    secret: bytes = field(repr=False)  # shape (32,)
    robot: bytes | None = field(default=None, repr=False)  # its public identity, shape (32,)
    identity: bytes = field(init=False, repr=False)  # by which calls name the key: no secret

    def __post_init__(self) -> None:
        made = blake2b(key=self.secret, person=b"TAMS key name", digest_size=IDENTITY_BYTES)
        object.__setattr__(self, "identity", made.digest())


# without a key file: no secret at all, for one computer only
LOOPBACK_KEY = Key("", bytes(KEY_BYTES))


def new_key(path: Path, name: str | None = None) -> Path:
    """Write a new random key; the file, mode 0600. The robot's identity is made if it has none.

    `path`: the file, or a folder that gets one. `name`: whose it is; None: as the file is called.
    ConfigError if it exists, cannot be made, or the name is none.
    """
    if is_folder(path):
        if name is None:
            raise ConfigError(f"{path}: is a folder; say whose key it is to get: --for NAME")
        path = path / f"{_valid(name)}{_SUFFIX}"
    name = _valid(path.stem if name is None else name)
    robot = identity_for_new_keys(path, os.urandom).public
    write_secret(path, f"{_MARK} {name} {encoded(os.urandom(KEY_BYTES))} {encoded(robot)}")
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
    says anything of what the file holds but the name of an older key.
    """
    mark, *words = read_secret(path, "a file that key new FILE made").split(" ")
    if mark == IDENTITY_MARK:
        raise ConfigError(
            f"--key: {path}: is a robot's identity, which belongs on the robot's computer alone; "
            "name a key that was made beside it, with: key new FILE"
        )
    name = words[0] if words and _NAME.fullmatch(words[0]) else None
    if mark == _MARK_WITHOUT_ROBOT and name is not None:
        raise ConfigError(
            f"--key: {path}: is a key of TAMS 3, which names no robot; delete it, make another on "
            f"the robot's computer with: key new FOLDER --for {name}, and copy that"
        )
    secret, robot = map(decoded, words[1:]) if len(words) == 3 else (b"", b"")
    if mark != _MARK or name is None or len(secret) != KEY_BYTES or len(robot) != PUBLIC_BYTES:
        raise ConfigError(f"--key: {path}: holds no key of TAMS; make one with: key new FILE")
    return Key(name, secret, robot)


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


def keys_of_robot(path: Path) -> tuple[RobotIdentity, list[Key]]:
    """The robot's identity in `path`, a file or a folder, and the keys that it accepts.

    ConfigError as of `accepted_keys` and `read_identity`, and for a key of another robot.
    """
    keys, identity = accepted_keys(path), read_identity(path)
    for key in keys:
        if key.robot != identity.public:
            raise ConfigError(
                f"--key: {path}: the key for {key.name} is another robot's; delete it, and make "
                f"one here with: key new FILE --for {key.name}"
            )
    return identity, keys


class AcceptedKeys:
    """The keys that the robot's side accepts, as its files stand; for a process that runs on."""

    def __init__(self, path: Path | None) -> None:
        """None: no secret, for one computer only. ConfigError as of `keys_of_robot`."""
        self._path = path
        self._stamp = self._stamped()
        if path is None:
            self.identity, keys = RobotIdentity.fresh(os.urandom), [LOOPBACK_KEY]
        else:
            self.identity, keys = keys_of_robot(path)
        self.keys = _by_identity(keys)

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
        self.keys = _by_identity([key for key in keys if key.robot == self.identity.public])
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
    return sorted(path.glob(f"*{_SUFFIX}")) if is_folder(path) else [path]


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
