"""Facts in shared memory, and the window's size on disk."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tams_app.errors import TamsError
from tams_app.faces.facts_memory import FactsReader, FactsWriter
from tams_app.faces.messages import Notice
from tams_app.faces.window.toolkit import Size, first_size, keep_size, read_size, size_file
from tests.faces.window.facts import FACTS, changed

pytestmark = pytest.mark.untimed


def test_the_reader_gets_the_newest_facts_once() -> None:
    writer = FactsWriter()
    reader = FactsReader(os.dup(writer.descriptor))
    assert reader.newer(0) is None
    for number in range(9):
        writer.put(changed(FACTS, t_s=float(number)))
    assert reader.newer(0) == changed(FACTS, t_s=8.0)
    assert reader.newer(0) is None
    writer.close()


def test_facts_leave_no_file_behind() -> None:
    writer = FactsWriter()
    mine = [name for name in os.listdir("/dev/shm") if name.startswith(f"tams-{os.getpid()}-")]
    assert mine == []
    writer.close()


def test_facts_that_do_not_fit_are_refused() -> None:
    writer = FactsWriter()
    with pytest.raises(ValueError, match="bytes"):
        writer.put(changed(FACTS, notices=(Notice(0.0, "x" * 40_000),)))
    writer.close()


@pytest.mark.parametrize(
    "content", ["", "[]", "{", '{"width": 3}', '{"width": "a", "height": 900}', '{"x": 1}']
)
def test_a_size_that_is_of_no_use_is_the_usual_one(tmp_path: Path, content: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(content)
    assert read_size(path) == Size()


def test_a_size_that_cannot_be_kept_is_told_of(tmp_path: Path) -> None:
    (tmp_path / "tams").write_text("a file, not a folder")
    with pytest.raises(TamsError, match="size cannot be kept"):
        keep_size(tmp_path / "tams" / "window.json", Size())


@pytest.mark.parametrize(
    ("screen", "maximised"),
    [((1280, 720), True), ((1366, 768), True), ((1600, 900), True), ((1920, 1080), False)],
)
def test_the_first_window_is_maximised_where_it_would_fill_most_of_the_screen(
    tmp_path: Path, screen: tuple[int, int], maximised: bool
) -> None:
    first = first_size(*screen)
    assert first == Size(1280, 720, maximised)
    path = size_file({"XDG_STATE_HOME": str(tmp_path)})
    assert read_size(path, first) == first
    keep_size(path, Size(1000, 600, True))
    assert read_size(path, first) == Size(1000, 600, True)
