"""`run_tams.py doctor`: checks this machine, and reports how to fix what is missing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from tams_app.config import Config
from tams_app.console.findings import Check, Finding, examine, verdict
from tams_app.printing import Console


def run_doctor(
    config: Config, checks: Sequence[Check], as_json: bool = False, console: Console | None = None
) -> int:
    """Run every check and print one line each; 0 if all that TAMS needs is there, else 1.

    `as_json`: print the findings as one list instead.
    """
    console = console or Console()
    found: list[Finding] = []
    for finding in examine(config, checks):
        found.append(finding)
        if not as_json:
            console.print(str(finding), soft_wrap=True)
    broken = sum(finding.is_broken for finding in found)
    if as_json:
        console.out(json.dumps([asdict(one) for one in found]))
    else:
        console.print(verdict(broken))
    return 1 if broken else 0
