"""`run_tams.py doctor`: looks at the machine and says, line by line, what to mend."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console

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


def run_doctor(config: Config, checks: Sequence[Check], console: Console | None = None) -> int:
    """Run every check and print one line each; 0 if all that TAMS needs is there, else 1."""
    console = console or Console()
    broken = 0
    for check in checks:
        for finding in check(config):
            console.print(_line(finding), markup=False, highlight=False, soft_wrap=True)
            broken += finding.essential and not finding.ok
    console.print(
        f"{broken} of these must be mended before TAMS can run."
        if broken
        else "All that TAMS needs is here.",
        highlight=False,
    )
    return 1 if broken else 0


def _line(finding: Finding) -> str:
    word = "ok     " if finding.ok else "MISSING" if finding.essential else "absent "
    detail = f" ({finding.detail})" if finding.detail else ""
    fix = "" if finding.ok else f": {finding.fix}"
    return f"{word} {finding.what}{detail}{fix}"
