"""What the doctor finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tams_app.config import Config


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at: whether it is there, if TAMS runs without it, and what mends it."""

    what: str
    ok: bool
    detail: str = ""
    fix: str = ""
    essential: bool = True


Check = Callable[[Config], Iterator[Finding]]
