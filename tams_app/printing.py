"""Text on the terminal: what a file holds is shown and never obeyed.

A log or a study may come from elsewhere. Control characters in its text could move the cursor,
rename the window or hide what was printed; brackets could be taken for rich's markup.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from rich.console import Console as RichConsole  # noqa: TID251  everything else uses ours
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

# C0 but tabulator and line feed, DEL, C1, and what changes the direction of text that follows
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
_WHOLE_WORDS: dict[str, Any] = {
    "expand_tabs": False,
    "replace_whitespace": False,
    "break_long_words": False,  # a path is longer than the line rather than in two pieces
    "break_on_hyphens": False,
}


def plain(text: str) -> str:
    """`text` without the characters that a terminal obeys."""
    return _CONTROL.sub("", text)


def known(value: float | None, form: str = "{:.0f}") -> str:
    """A number in a form of `str.format`, a dash for what is not known."""
    return "–" if value is None else form.format(value)


class Console(RichConsole):
    """A console that prints text as it is, without markup, highlights and control characters."""

    def __init__(self, **options: Any) -> None:
        """`options`: those of rich."""
        super().__init__(**({"markup": False, "emoji": False, "highlight": False} | options))

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            if segment.control is None and _CONTROL.search(segment.text):
                segment = Segment(plain(segment.text), segment.style)
            yield segment

    def print(self, *objects: Any, soft_wrap: bool | None = None, **how: Any) -> None:
        """Print as rich does, but end soft lines between words on a terminal.

        What is to be copied whole, such as a command, is printed with `no_wrap` as well.
        """
        if soft_wrap and self.is_terminal and not how.get("no_wrap"):
            objects = tuple(self._between_words(one) for one in objects)
        super().print(*objects, soft_wrap=soft_wrap, **how)

    def _between_words(self, one: Any) -> Any:
        if isinstance(one, Text) and not one.spans:
            return Text(self._between_words(one.plain), one.style)
        if not isinstance(one, str):
            return one
        lines = plain(one).split("\n")
        return "\n".join(textwrap.fill(line, self.width, **_WHOLE_WORDS) for line in lines)

    def render_str(self, text: str, **how: Any) -> Text:
        """Render as rich does, measured without what will not be printed."""
        return super().render_str(plain(text), **how)


class PlainOutput:
    """A text file for programs, that leaves out control characters where a person reads it."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._person = file.isatty()

    def write(self, text: str) -> int:
        return self._file.write(plain(text.replace("\r\n", "\n")) if self._person else text)


@contextmanager
def waiting(what: str, console: Console) -> Iterator[None]:
    """Show `what` while the work inside lasts: moving on a terminal, as one line elsewhere."""
    sentence = f"{what} …"
    if console.is_terminal:
        with console.status(sentence):
            yield
    else:
        console.print(sentence, soft_wrap=True)
        yield
