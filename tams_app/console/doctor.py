"""`run_tams.py doctor`: looks at the machine and says, line by line, what to mend."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from tams_app.config import Config
from tams_app.console.checks import CHECKS
from tams_app.console.findings import Check, Finding


def run_doctor(
    config: Config, console: Console | None = None, checks: Sequence[Check] = CHECKS
) -> int:
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
