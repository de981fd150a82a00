"""What mutation testing found: counts per module, and whether every survivor is explained.

mutmut numbers its mutants anew with every edit of the code. Here a mutant is known by the function
that it is in and by the line that it makes, so that an explanation outlives such edits.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

KILLED = "killed"
CAUGHT_BY_TYPES = "caught by type check"
_RESULT = re.compile(r"^\s*(?P<name>\S+): (?P<status>[\w ]+)$", re.MULTILINE)
_ENTRY = re.compile(r"^- `(?P<where>[^`]+)`: `(?P<line>[^`]+)`$", re.MULTILINE)


@dataclass(frozen=True, slots=True, order=True)
class Mutant:
    """`where`: module.Class.method or module.function; `line`: what it makes of the code."""

    where: str
    line: str


def statuses(results: str) -> dict[str, str]:
    """Status of each mutant by mutmut's name for it, from `mutmut results --all true`."""
    return {found["name"]: found["status"] for found in _RESULT.finditer(results)}


def where(name: str) -> str:
    """`pkg.mod.xǁClassǁmethod__mutmut_3` and `pkg.mod.x_function__mutmut_3` as people write it."""
    path, _, function = name.rpartition("__mutmut_")[0].rpartition(".")
    module = path.rpartition(".")[2]
    if function.startswith("xǁ"):
        return ".".join((module, *function.removeprefix("xǁ").split("ǁ")))
    return f"{module}.{function.removeprefix('x_')}"


def changed_line(diff: str) -> str:
    """The line or lines that a mutant makes, from `mutmut show`; as one line."""
    added = [line[1:].strip() for line in diff.splitlines() if re.match(r"\+(?!\+)", line)]
    return " ".join(added)


def totals(by_name: Mapping[str, str]) -> str:
    """One line per module: how many mutants came to which end."""
    modules: dict[str, Counter[str]] = {}
    for name, status in by_name.items():
        modules.setdefault(where(name).partition(".")[0], Counter())[status] += 1
    lines = []
    for module, counts in sorted(modules.items()):
        ends = ", ".join(f"{count} {status}" for status, count in counts.most_common())
        lines.append(f"{module}: {counts.total()} mutants: {ends}")
    return "\n".join(lines)


def explained(text: str) -> set[Mutant]:
    """The mutants that SURVIVORS.md lists, each as: - `where`: `line`."""
    return {Mutant(entry["where"], entry["line"]) for entry in _ENTRY.finditer(text)}


def render(by_name: Mapping[str, str], survivors: Iterable[Mutant]) -> str:
    """RESULT.txt whole."""
    listed = "\n".join(f"{mutant.where}\n    {mutant.line}" for mutant in sorted(set(survivors)))
    return f"{totals(by_name)}\n\nSurvivors (each explained in SURVIVORS.md):\n\n{listed}\n"
