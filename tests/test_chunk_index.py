"""The index at the end of a log is the one that the SDK itself would have written."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.summary import Summary

from tams_app.errors import LogError
from tams_app.recording import mcap_log, read_log
from tams_app.recording.mcap_log import McapLog
from tams_app.records import Note
from tests.synthetic_session import START_NS, header, tick

pytestmark = pytest.mark.untimed


def write(path: Path) -> None:
    log = McapLog(path, header())
    for number in range(40):
        log.write(tick(number), 0)
        if number % 3 == 0:  # so that chunks differ in their channels
            log.write(Note(START_NS + number, "info", f"note {number}"), 0)
        if number % 4 == 0:
            log.flush()
    log.close()


def summary_of(path: Path) -> Summary:
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    return summary


def test_the_chunks_are_indexed_as_the_sdk_indexes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "ours.mcap")
    options = mcap_log.MCAPWriteOptions

    def with_index(**chosen: Any) -> Any:
        return options(**{**chosen, "emit_chunk_indexes": True})

    monkeypatch.setattr(mcap_log, "MCAPWriteOptions", with_index)
    monkeypatch.setattr(mcap_log, "add_chunk_indexes", lambda _path: None)
    write(tmp_path / "theirs.mcap")
    ours, theirs = summary_of(tmp_path / "ours.mcap"), summary_of(tmp_path / "theirs.mcap")
    assert len(theirs.chunk_indexes) > 10
    assert ours.chunk_indexes == theirs.chunk_indexes
    assert ours.statistics == theirs.statistics
    assert ours.channels == theirs.channels
    assert (tmp_path / "ours.mcap").stat().st_size == (tmp_path / "theirs.mcap").stat().st_size


def test_a_disk_that_refuses_the_index_is_told_and_the_log_is_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> None:
        os.truncate(path, path.stat().st_size - 1000)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(mcap_log, "add_chunk_indexes", refuse)
    with pytest.raises(LogError, match=r"session\.mcap: the index .*No space left.*is readable$"):
        write(tmp_path / "session.mcap")
    log = read_log(tmp_path / "session.mcap")
    assert len(log.ticks) == 40
    assert log.truncated


def test_a_log_whose_process_ended_before_the_index_was_added_is_read_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_log, "add_chunk_indexes", lambda _path: None)
    write(tmp_path / "session.mcap")
    log = read_log(tmp_path / "session.mcap")
    assert len(log.ticks) == 40
    assert log.complete
