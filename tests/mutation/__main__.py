"""Writes RESULT.txt from mutmut's last run; fails if a survivor is not explained."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.mutation.report import (
    CAUGHT_BY_TYPES,
    KILLED,
    Mutant,
    changed_line,
    explained,
    render,
    statuses,
    where,
)

HERE = Path(__file__).parent


def mutmut(*arguments: str) -> str:
    command = [sys.executable, "-m", "mutmut", *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main() -> str | None:
    """Write the result; what is wrong, as the exit code and message, or None."""
    by_name = {
        name: status
        for name, status in statuses(mutmut("results", "--all", "true")).items()
        if status != "not checked"
    }
    if not by_name:
        return "Nothing was mutated: run `mutmut run` first."
    alive = [name for name, end in by_name.items() if end not in (KILLED, CAUGHT_BY_TYPES)]
    survivors = [Mutant(where(name), changed_line(mutmut("show", name))) for name in alive]
    (HERE / "RESULT.txt").write_text(render(by_name, survivors), encoding="utf-8")
    known = explained((HERE / "SURVIVORS.md").read_text(encoding="utf-8"))
    unexplained = sorted(set(survivors) - known)
    return (
        "\n".join(f"not explained: {mutant.where}: {mutant.line}" for mutant in unexplained) or None
    )


if __name__ == "__main__":
    sys.exit(main())
