"""The key's file: made for its owner alone, and refused where it is no secret or no key."""

from __future__ import annotations

import base64
import errno
import os
import stat
import tracemalloc
from pathlib import Path
from typing import NoReturn

import pytest

from tams_app.errors import ConfigError
from tams_app.link.identity import PUBLIC_BYTES, read_identity
from tams_app.link.keys import (
    KEY_BYTES,
    LOOPBACK_KEY,
    AcceptedKeys,
    Key,
    accepted_keys,
    keys_of_robot,
    new_key,
    read_key,
    revoke_key,
)

pytestmark = pytest.mark.untimed

SECRET = base64.b64encode(bytes(range(100, 100 + KEY_BYTES))).decode()
PUBLIC = bytes(range(200, 200 + PUBLIC_BYTES))
ROBOT = base64.b64encode(PUBLIC).decode()
LINE = f"tams-key-3 kim {SECRET} {ROBOT}\n".encode()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "arm.key"


def write(path: Path, content: bytes, mode: int = 0o600) -> None:
    path.write_bytes(content)
    path.chmod(mode)


def test_new_keys_can_be_read_back_and_differ(tmp_path: Path) -> None:
    paths = [new_key(tmp_path / f"{name}.key") for name in "ab"]
    keys = [read_key(path) for path in paths]
    assert keys == [read_key(path) for path in paths]
    assert [(len(key.secret), key.name) for key in keys] == [(KEY_BYTES, "a"), (KEY_BYTES, "b")]
    for part in ("secret", "identity"):
        assert len({getattr(key, part) for key in (*keys, LOOPBACK_KEY)}) == 3
    assert keys[0].robot == keys[1].robot == read_identity(tmp_path).public


def test_all_computers_make_the_same_of_a_secret() -> None:
    """Known answers, by OpenSSL (BLAKE2BMAC); with others two versions could not connect."""
    key = Key("kim", bytes(range(100, 100 + KEY_BYTES)))
    assert key.identity.hex() == "a602b2d99b761efd"


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
    write(path, LINE, mode)
    with pytest.raises(ConfigError) as refused:
        read_key(path)
    assert f"chmod 600 {path}" in str(refused.value)
    assert SECRET not in str(refused.value)


def test_a_file_of_its_owner_alone_is_read_and_a_key_shown_by_mistake_shows_its_name_alone(
    path: Path,
) -> None:
    write(path, LINE, 0o400)
    assert read_key(path) == Key("kim", bytes(range(100, 100 + KEY_BYTES)), PUBLIC)
    assert repr(read_key(path)) == "Key(name='kim')"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        SECRET.encode(),
        f"tams-key-1 {SECRET}".encode(),
        f"tams-key-2 {SECRET}".encode(),
        f"tams-key-3 {SECRET} {ROBOT}".encode(),
        f"tams-key-3 kim {SECRET}".encode(),
        f"tams-key-3 kim {SECRET} ".encode(),
        f"tams-key-3 k/im {SECRET} {ROBOT}".encode(),
        f"tams-key-3kim {SECRET} {ROBOT}".encode(),
        f"tams-key-3 kim {SECRET[:-4]} {ROBOT}".encode(),
        f"tams-key-3 kim {SECRET}AAAA {ROBOT}".encode(),
        f"tams-key-3 kim {SECRET} {ROBOT[:-4]}".encode(),
        f"tams-key-3 kim {SECRET} {ROBOT} {ROBOT}".encode(),
        f"tams-key-3 kim {SECRET[:20]}\n{SECRET[20:]} {ROBOT}".encode(),
        b"tams-key-3 kim \xff\xfe" + f"{SECRET} {ROBOT}".encode(),
        b"-----BEGIN OPENSSH PRIVATE KEY-----\n" + SECRET.encode(),
        bytes(range(256)) * 40,
    ],
    ids=lambda content: content[:12].hex(),  # plain, so that a runner can ask for one
)
def test_what_is_no_key_is_refused_and_not_told(path: Path, content: bytes) -> None:
    write(path, content)
    with pytest.raises(ConfigError) as refused:
        read_key(path)
    assert str(refused.value) == f"--key: {path}: holds no key of TAMS; make one with: key new FILE"
    assert refused.value.__cause__ is None


def test_a_key_of_version_3_is_refused_with_what_to_do(path: Path) -> None:
    """On both sides; on the robot's before it is missed that there is no identity."""
    write(path, f"tams-key-2 kim {SECRET}\n".encode())
    for use in (read_key, keys_of_robot):
        with pytest.raises(ConfigError) as refused:
            use(path)
        assert str(refused.value) == (
            f"--key: {path}: is a key of TAMS 3, which names no robot; delete it, make another on "
            "the robot's computer with: key new FOLDER --for kim, and copy that"
        )


def test_an_identity_that_was_taken_for_a_key_is_refused_and_not_told(tmp_path: Path) -> None:
    new_key(tmp_path, "kim")
    with pytest.raises(ConfigError) as refused:
        read_key(tmp_path / "robot.identity")
    assert str(refused.value) == (
        f"--key: {tmp_path / 'robot.identity'}: is a robot's identity, which belongs on the "
        "robot's computer alone; name a key that was made beside it, with: key new FILE"
    )


def test_of_a_large_file_no_more_is_read_than_a_key_can_be(path: Path) -> None:
    write(path, b"")
    os.truncate(path, 50_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match="holds no key of TAMS"):
            read_key(path)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("is_folder", [False, True])
def test_what_cannot_be_read_is_refused_with_what_to_do(path: Path, is_folder: bool) -> None:
    if is_folder:
        path.mkdir()
    with pytest.raises(ConfigError, match=r"cannot be read \(.+\); name a file that key new FILE"):
        read_key(path)


# --- several ------------------------------------------------------------------------------------


def names(accepted: AcceptedKeys) -> set[str]:
    return {key.name for key in accepted.keys.values()}


def test_a_key_is_for_whom_it_was_made(tmp_path: Path) -> None:
    assert read_key(new_key(tmp_path / "a.key", "kim")).name == "kim"
    assert new_key(tmp_path, "kay") == tmp_path / "kay.key"
    assert read_key(tmp_path / "kay.key").name == "kay"
    assert {key.name for key in accepted_keys(tmp_path)} == {"kim", "kay"}
    assert [key.name for key in accepted_keys(tmp_path / "a.key")] == ["kim"]


def test_in_a_folder_a_key_needs_a_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--for NAME"):
        new_key(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", "a b", "../x", ".x", "x" * 33, "a\n", "[red]x", "é"])
def test_what_is_no_name_is_refused_and_makes_no_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="is no name"):
        new_key(tmp_path, name)
    with pytest.raises(ConfigError, match="is no name"):
        new_key(tmp_path / "x.key", name)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_keys_or_with_one_name_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has no key"):
        accepted_keys(tmp_path)
    new_key(tmp_path / "a.key", "kay")
    new_key(tmp_path / "b.key", "kim")
    new_key(tmp_path / "c.key", "kim")
    with pytest.raises(ConfigError, match="two keys are for kim"):
        accepted_keys(tmp_path)


def test_a_revoked_key_is_accepted_no_longer_and_a_new_one_is_at_the_next_look(
    tmp_path: Path,
) -> None:
    new_key(tmp_path, "kim")
    new_key(tmp_path, "kay")
    accepted = AcceptedKeys(tmp_path)
    assert names(accepted) == {"kim", "kay"}
    assert not accepted.look()
    assert revoke_key(tmp_path, "kim") == tmp_path / "kim.key"
    assert not (tmp_path / "kim.key").exists()
    assert accepted.look()
    assert names(accepted) == {"kay"}
    new_key(tmp_path, "kit")
    assert accepted.look()
    assert names(accepted) == {"kay", "kit"}
    assert not accepted.look()


def test_a_key_that_others_can_reach_meanwhile_is_accepted_no_longer(tmp_path: Path) -> None:
    path = new_key(tmp_path, "kim")
    accepted = AcceptedKeys(path)
    path.chmod(0o644)
    assert accepted.look()
    assert names(accepted) == set()
    path.chmod(0o600)
    assert accepted.look()
    assert names(accepted) == {"kim"}
    path.unlink()
    assert accepted.look()
    assert names(accepted) == set()


@pytest.mark.parametrize("damaged", ["a", "b", "c"])
def test_a_key_that_is_damaged_takes_nobody_elses_place(tmp_path: Path, damaged: str) -> None:
    for name in "abc":
        new_key(tmp_path, name)
    accepted = AcceptedKeys(tmp_path)
    (tmp_path / f"{damaged}.key").write_bytes(b"half wri")
    assert accepted.look()
    assert names(accepted) == set("abc") - {damaged}


def test_to_revoke_what_is_not_there_is_refused_with_what_is(tmp_path: Path) -> None:
    new_key(tmp_path, "kim")
    new_key(tmp_path, "kit")
    with pytest.raises(ConfigError, match=r"has no one key for 'kay'; it has: kim, kit$"):
        revoke_key(tmp_path, "kay")
    assert [key.name for key in accepted_keys(tmp_path)] == ["kim", "kit"]


def test_a_key_that_is_damaged_is_revoked_by_the_name_of_its_file(tmp_path: Path) -> None:
    new_key(tmp_path, "kay")
    damaged = new_key(tmp_path, "kim")
    damaged.write_bytes(b"half wri")
    assert revoke_key(tmp_path, "kim") == damaged
    assert not damaged.exists()
    assert [key.name for key in accepted_keys(tmp_path)] == ["kay"]


def test_a_key_that_cannot_be_deleted_is_told_in_a_sentence(tmp_path: Path) -> None:
    """As in a folder that is another user's; here by a folder of its name."""
    (tmp_path / "kim.key").mkdir()
    with pytest.raises(ConfigError) as refused:
        revoke_key(tmp_path, "kim")
    assert str(refused.value).startswith(f"{tmp_path / 'kim.key'}: cannot be deleted (")


def test_without_a_file_one_computer_shares_no_secret() -> None:
    accepted = AcceptedKeys(None)
    assert list(accepted.keys.values()) == [LOOPBACK_KEY]
    assert not accepted.look()


def test_a_path_that_cannot_be_looked_at_is_told_in_a_sentence(tmp_path: Path) -> None:
    """As a folder below one that is another user's; here by a name that no folder can have."""
    path = tmp_path / ("k" * 300)
    for use in (accepted_keys, new_key, AcceptedKeys):
        with pytest.raises(ConfigError):
            use(path)


def test_keys_that_can_no_longer_be_looked_at_are_accepted_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new_key(tmp_path, "kim")
    accepted = AcceptedKeys(tmp_path)

    def refuse(*_: object, **__: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "stat", refuse)
        patch.setattr(Path, "open", refuse)
        is_new = accepted.look()
    assert is_new
    assert not accepted.keys


# --- the robot's identity beside them -----------------------------------------------------------


def test_the_first_key_makes_the_identity_and_the_others_keep_it(tmp_path: Path) -> None:
    new_key(tmp_path, "kim")
    identity, _ = keys_of_robot(tmp_path)
    assert stat.S_IMODE((tmp_path / "robot.identity").stat().st_mode) == 0o600
    new_key(tmp_path, "kay")
    new_key(tmp_path / "one.key")
    assert read_identity(tmp_path) == identity == keys_of_robot(tmp_path / "one.key")[0]
    assert {key.robot for key in keys_of_robot(tmp_path)[1]} == {identity.public}


def test_the_private_half_of_an_identity_is_in_no_key_and_is_not_shown(tmp_path: Path) -> None:
    path = new_key(tmp_path, "kim")
    private = read_identity(tmp_path).private
    assert base64.b64encode(private) in (tmp_path / "robot.identity").read_bytes()
    assert base64.b64encode(private) not in path.read_bytes()
    assert repr(private) not in repr(read_identity(tmp_path))


def test_no_key_is_made_where_the_identity_is_damaged_or_open_to_others(tmp_path: Path) -> None:
    new_key(tmp_path, "kim")
    file = tmp_path / "robot.identity"
    file.chmod(0o640)
    with pytest.raises(ConfigError, match=r"robot\.identity: others can read it; run: chmod 600 "):
        new_key(tmp_path, "kay")
    for damaged in (
        b"",
        b"tams-robot-1 AAAA",
        b"tams-key-3 " + SECRET.encode(),
        file.read_bytes()[:-5],
        (tmp_path / "kim.key").read_bytes(),
    ):
        write(file, damaged)
        with pytest.raises(ConfigError, match="holds no robot's identity; delete it and all keys"):
            new_key(tmp_path, "kay")
    assert not (tmp_path / "kay.key").exists()


def test_the_robots_side_is_not_started_without_its_identity(tmp_path: Path) -> None:
    path = new_key(tmp_path, "kim")
    (tmp_path / "robot.identity").unlink()
    for given in (path, tmp_path):
        with pytest.raises(ConfigError) as refused:
            AcceptedKeys(given)
        assert str(refused.value) == (
            f"--key: {tmp_path / 'robot.identity'}: cannot be read (No such file or directory); "
            "name keys that were made on this computer, with: key new FILE"
        )


def test_another_robots_key_is_refused_and_when_it_comes_later_not_accepted(tmp_path: Path) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
        new_key(tmp_path / folder, f"of-{folder}")
    accepted = AcceptedKeys(tmp_path / "a")
    (tmp_path / "b" / "of-b.key").rename(tmp_path / "a" / "of-b.key")
    assert accepted.look()
    assert names(accepted) == {"of-a"}
    with pytest.raises(ConfigError, match="the key for of-b is another robot's; delete it"):
        AcceptedKeys(tmp_path / "a")


def test_half_a_key_is_not_left_behind_when_the_disk_is_full(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new_key(path)

    def refuse(_: int) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(ConfigError, match=r"cannot be written \(No space left on device\)"):
        new_key(path.with_name("other.key"))
    assert {file.name for file in path.parent.iterdir()} == {"arm.key", "robot.identity"}


def test_without_a_file_the_robot_is_another_one_each_time() -> None:
    assert AcceptedKeys(None).identity != AcceptedKeys(None).identity
