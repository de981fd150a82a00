"""Who the robot is: a long-lived Ed25519 key (RFC 8032), in a file that never leaves its computer.

Its public half stands in the operators' keys, so that they know the robot that they call. The file
lies beside the keys of the robot's side.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from tams_app.errors import ConfigError
from tams_app.link.secret_file import decoded, encoded, is_folder, read_secret, write_secret

PUBLIC_BYTES = 32
IDENTITY_MARK = "tams-robot-1"
_PRIVATE_BYTES = 32
_FILE_NAME = "robot.identity"


@dataclass(frozen=True, slots=True)
class RobotIdentity:
    """A robot's key pair."""

    private: bytes = field(repr=False)  # shape (32,)
    public: bytes = field(init=False)  # shape (32,): by which operators know the robot

    def __post_init__(self) -> None:
        object.__setattr__(self, "public", self.signer().public_key().public_bytes_raw())

    @staticmethod
    def fresh(random: Callable[[int], bytes]) -> RobotIdentity:
        """A new one. `random`: as many unpredictable bytes as it is asked for."""
        return RobotIdentity(random(_PRIVATE_BYTES))

    def signer(self) -> Ed25519PrivateKey:
        """What signs as this robot."""
        return Ed25519PrivateKey.from_private_bytes(self.private)


def identity_file(path: Path) -> Path:
    """Where the identity lies that belongs to the keys in `path`, a file or a folder."""
    return (path if is_folder(path) else path.parent) / _FILE_NAME


def read_identity(path: Path) -> RobotIdentity:
    """The robot's identity beside the keys in `path`, a file or a folder.

    ConfigError if it is not there, cannot be read, holds none, or if others may read it.
    """
    file = identity_file(path)
    line = read_secret(file, "keys that were made on this computer, with: key new FILE")
    mark, _, word = line.partition(" ")
    private = decoded(word)
    if mark != IDENTITY_MARK or len(private) != _PRIVATE_BYTES:
        raise ConfigError(
            f"--key: {file}: holds no robot's identity; delete it and all keys beside it, and make "
            "new ones with: key new FILE"
        )
    return RobotIdentity(private)


def identity_for_new_keys(path: Path, random: Callable[[int], bytes]) -> RobotIdentity:
    """The identity beside keys in `path`, made if there is none. ConfigError as for the others."""
    file = identity_file(path)
    if not os.path.lexists(file):
        made = RobotIdentity.fresh(random)
        write_secret(file, f"{IDENTITY_MARK} {encoded(made.private)}")
    return read_identity(path)
