"""Shared memory by name."""

from __future__ import annotations

import pytest

from tams_app.runtime.shared_ring import create_block, new_block_name, open_block, remove_block

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
