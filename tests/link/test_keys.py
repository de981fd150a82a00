"""The key's file: made for its owner alone, and refused where it is no secret or no key."""

from __future__ import annotations

import base64
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from tams_app.errors import ConfigError
from tams_app.link.keys import KEY_BYTES, LOOPBACK_KEY, new_key, read_key

pytestmark = pytest.mark.untimed

SECRET = base64.b64encode(bytes(range(100, 100 + KEY_BYTES))).decode()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "arm.key"


def write(path: Path, content: bytes, mode: int = 0o600) -> None:
    path.write_bytes(content)
    path.chmod(mode)


def test_a_new_key_can_be_read_back(path: Path) -> None:
    new_key(path)
    assert len(read_key(path)) == KEY_BYTES
    assert read_key(path) == read_key(path) != LOOPBACK_KEY


def test_two_new_keys_differ(tmp_path: Path) -> None:
    new_key(tmp_path / "a")
    new_key(tmp_path / "b")
    assert read_key(tmp_path / "a") != read_key(tmp_path / "b")


@pytest.mark.parametrize("umask", [0, 0o022, 0o077])
def test_a_new_key_is_for_its_owner_alone_whatever_the_umask(path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        new_key(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@pytest.mark.parametrize("link", [False, True])
def test_a_new_key_never_overwrites(path: Path, link: bool) -> None:
    target = path.with_name("target") if link else path
    target.write_bytes(b"precious")
    if link:
        path.symlink_to(target)
    with pytest.raises(ConfigError, match="is there already; give another name"):
        new_key(path)
    assert target.read_bytes() == b"precious"


def test_a_new_key_where_nothing_can_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot be written \(.+\); name another place"):
        new_key(tmp_path / "none" / "arm.key")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o610, 0o601, 0o644])
def test_a_key_that_others_can_reach_is_refused(path: Path, mode: int) -> None:
    write(path, f"tams-key-1 {SECRET}\n".encode(), mode)
    with pytest.raises(ConfigError) as refused:
        read_key(path)
    assert f"chmod 600 {path}" in str(refused.value)
    assert SECRET not in str(refused.value)


def test_a_file_of_its_owner_alone_is_read(path: Path) -> None:
    write(path, f"tams-key-1 {SECRET}\n".encode(), 0o400)
    assert read_key(path) == bytes(range(100, 100 + KEY_BYTES))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        SECRET.encode(),
        f"tams-key-2 {SECRET}".encode(),
        f"tams-key-1{SECRET}".encode(),
        f"tams-key-1 {SECRET[:-4]}".encode(),
        f"tams-key-1 {SECRET}AAAA".encode(),
        f"tams-key-1 {SECRET} {SECRET}".encode(),
        f"tams-key-1 {SECRET[:20]}\n{SECRET[20:]}".encode(),
        b"tams-key-1 \xff\xfe" + SECRET.encode(),
        b"-----BEGIN OPENSSH PRIVATE KEY-----\n" + SECRET.encode(),
        bytes(range(256)) * 40,
    ],
    ids=lambda content: str(content[:16]),
)
def test_what_is_no_key_is_refused_and_not_told(path: Path, content: bytes) -> None:
    write(path, content)
    with pytest.raises(ConfigError) as refused:
        read_key(path)
    assert str(refused.value) == f"--key: {path}: holds no key of TAMS; make one with: key new FILE"
    assert refused.value.__cause__ is None


def _absent(path: Path) -> None:
    pass


def _directory(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [_absent, _directory])
def test_what_cannot_be_read_is_refused_with_what_to_do(
    path: Path, make: Callable[[Path], None]
) -> None:
    make(path)
    with pytest.raises(ConfigError, match=r"cannot be read \(.+\); name a file that key new FILE"):
        read_key(path)
