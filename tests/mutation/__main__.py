"""`python -m tests.mutation [--again | MODULE.py ...]`: mutates, tests, and renews RESULT.txt.

Without modules it tries all; those that it leaves out keep the result that they had, with git's
name for the code that it is of. With `--again` it tries only what the last run in this folder did
not catch, for tests that were added since: none of them brings a caught mutant back. It fails as
long as a module has no result on today's code, or a mutant survives that did not before.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

from tests.mutation.report import (
    CAUGHT,
    NOT_TRIED,
    ModuleResult,
    Mutant,
    blob_of,
    changed_line,
    counts_of,
    module_path,
    mutated_modules,
    read,
    render,
    statuses,
    unfinished,
    where,
)

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RESULT = HERE / "RESULT.txt"
AGAIN = "--again"


def blobs_today() -> dict[str, str]:
    """git's names for the modules that are mutated, by path, as they are now."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["mutmut"]
    return {path: blob_of(ROOT / path) for path in mutated_modules(ROOT, settings["only_mutate"])}


def results_today() -> dict[str, ModuleResult]:
    """What RESULT.txt says."""
    return read(RESULT.read_text("utf-8"))


def mutmut(*arguments: str) -> str:
    command = [sys.executable, "-m", "mutmut", *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def try_mutants(paths: Iterable[str]) -> None:
    """Make the mutants of all modules anew, and try those of these."""
    shutil.rmtree(ROOT / "mutants", ignore_errors=True)
    run([path.removesuffix(".py").replace("/", ".") + ".*" for path in paths])


def try_again() -> None:
    """Try the mutants of the last run that nothing caught."""
    ends = statuses(mutmut("results", "--all", "true"))
    if left := [name for name, end in ends.items() if end not in (*CAUGHT, NOT_TRIED)]:
        run(left)


def run(names: Iterable[str]) -> None:
    """Try the mutants of these names or patterns."""
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", "1", *names]
    subprocess.run(command, check=True)


def tried(blobs: Mapping[str, str]) -> dict[str, ModuleResult]:
    """The results of the last run, of the modules that it tried whole or that have no mutants."""
    by_module: dict[str, dict[str, str]] = {path: {} for path in blobs}
    for name, status in statuses(mutmut("results", "--all", "true")).items():
        by_module.setdefault(module_path(name), {})[name] = status
    results = {}
    for path, ends in by_module.items():
        if path not in blobs or NOT_TRIED in ends.values():
            continue
        survivors = tuple(
            Mutant(where(name), changed_line(mutmut("show", name)))
            for name, end in ends.items()
            if end not in CAUGHT
        )
        results[path] = ModuleResult(path, blobs[path], counts_of(ends.values()), survivors)
    return results


def main(wanted: list[str]) -> str | None:
    """Try the modules wanted (or all); what is wrong, as the exit code and message, or None."""
    before = blobs_today()
    if wanted != [AGAIN] and (unknown := sorted(set(wanted) - before.keys())):
        return f"Not among the modules that are mutated: {', '.join(unknown)}"
    if wanted == [AGAIN]:
        try_again()
    else:
        try_mutants(wanted or before)
    after = blobs_today()
    unchanged = {path: blob for path, blob in before.items() if after.get(path) == blob}
    results = tried(unchanged)
    known = {path: one for path, one in results_today().items() if path in after}
    RESULT.write_text(render(known | results), encoding="utf-8")
    return "\n".join(unfinished(known | results, after, known)) or None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
