"""What is printed never waits for the screen."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from typing import TextIO

import pytest

from tams_app.faces.terminal import output
from tams_app.faces.terminal.output import CAPACITY, unblocked_output

pytestmark = pytest.mark.untimed
LONG = "x" * 4095


@pytest.fixture
def pipe() -> Iterator[tuple[int, TextIO]]:
    read, written = os.pipe()
    with os.fdopen(written, "w", encoding="utf-8") as ours:
        yield read, ours
    os.close(read)


def test_all_that_is_printed_comes_in_its_order(pipe: tuple[int, TextIO]) -> None:
    read, ours = pipe
    with redirect_stdout(ours), unblocked_output():
        for number in range(100):
            sys.stdout.write(f"{number}" + "\n")
    assert os.read(read, 65536).decode().split() == [str(number) for number in range(100)]


def test_a_pipe_that_takes_nothing_holds_up_neither_what_prints_nor_the_end(
    pipe: tuple[int, TextIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "PATIENCE_S", 0.2)
    with redirect_stdout(pipe[1]), unblocked_output():
        for _ in range(3 * CAPACITY):
            sys.stdout.write(LONG + "\n")


def test_a_screen_that_is_gone_is_an_error_only_at_the_end(pipe: tuple[int, TextIO]) -> None:
    os.dup2(os.open("/dev/full", os.O_WRONLY), pipe[1].fileno())
    with redirect_stdout(pipe[1]), pytest.raises(OSError, match="No space"), unblocked_output():
        sys.stdout.write("a")


def test_a_stream_in_memory_stays_as_it_is() -> None:
    with redirect_stdout(io.StringIO()) as text, unblocked_output():
        assert sys.stdout is text
