"""Signs of progress for a person, while work takes its time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tams_app.printing import Console


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
