"""Shared memory by name."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from tams_app.errors import SetupError
from tams_app.runtime.shared_ring import (
    create_block,
    new_block_name,
    open_block,
    remove_block,
    require_room,
)

pytestmark = pytest.mark.waiting


def test_what_one_writes_another_reads_until_both_let_go() -> None:
    name = new_block_name()
    with create_block(name, 5000) as block, open_block(name) as same:
        remove_block(name)
        remove_block(name)
        block[4990:4995] = b"hello"
        assert same[4990:4995] == b"hello"
        assert len(same) == 5000
        with pytest.raises(TypeError):
            same[0:1] = b"x"
    with pytest.raises(FileNotFoundError):
        open_block(name)


def test_a_block_outlives_its_maker() -> None:
    name = new_block_name()
    try:
        with create_block(name, 100) as block:
            block[0:2] = b"ab"
        with create_block(name, 100) as again:
            assert again[0:3] == b"ab\0"
    finally:
        remove_block(name)


def test_names_are_unique() -> None:
    assert len({new_block_name() for _ in range(100)}) == 100


def test_a_block_without_room_is_refused_in_one_sentence_and_not_left_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(_descriptor: int, _start: int, _size: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    name = new_block_name()
    with pytest.raises(SetupError, match=r"has no room for 44 MB of shared memory: make it larger"):
        create_block(name, 43_100_000)
    assert not Path("/dev/shm", name).exists()


def test_a_block_has_its_memory_before_anything_is_written() -> None:
    name = new_block_name()
    with create_block(name, 1 << 20):
        allocated = Path("/dev/shm", name).stat().st_blocks * 512
        remove_block(name)
    assert allocated == 1 << 20


def test_room_is_looked_for_before_anything_is_made() -> None:
    require_room(1)
    with pytest.raises(SetupError, match=r"no room for 1000000000000 MB"):
        require_room(10**18)
