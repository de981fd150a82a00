"""Results of mutation testing, by module: counts, survivors, and the code that they are of.

mutmut numbers its mutants anew with every edit of the code. Here a mutant is known by the function
that it is in and by the line that it makes, so that a known survivor outlives such edits.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

KILLED = "killed"
CAUGHT_BY_TYPES = "caught by type check"
TIMEOUT = "timeout"  # a test that does not end is a test that fails
NOT_TRIED = "not checked"
CAUGHT = (KILLED, CAUGHT_BY_TYPES, TIMEOUT)
_RESULT = re.compile(r"^\s*(?P<name>\S+): (?P<status>[\w ]+)$", re.MULTILINE)
_MODULE = re.compile(r"^(?P<path>\S+\.py) (?P<blob>[0-9a-f]{40})$")
_SURVIVOR = re.compile(r"^    (?P<where>\S+): (?P<line>.+)$")


@dataclass(frozen=True, slots=True, order=True)
class Mutant:
    """`where`: package.module.Class.method or package.module.function; `line`: what it makes."""

    where: str
    line: str


@dataclass(frozen=True, slots=True)
class ModuleResult:
    """What became of the mutants of one module.

    blob: git's name for the contents that the mutants were made from.
    """

    path: str
    blob: str
    counts: str
    survivors: tuple[Mutant, ...] = field(default=())


def statuses(results: str) -> dict[str, str]:
    """Status of each mutant by mutmut's name for it, from `mutmut results --all true`."""
    return {found["name"]: found["status"] for found in _RESULT.finditer(results)}


def module_path(name: str) -> str:
    """File of a mutant, from mutmut's name for it."""
    return _module_of(name).replace(".", "/") + ".py"


def where(name: str) -> str:
    """`pkg.mod.xǁClassǁmethod__mutmut_3` and `pkg.mod.x_function__mutmut_3` as people write it."""
    module = _module_of(name).removeprefix("tams_app.")
    function = name.rpartition("__mutmut_")[0].rpartition(".")[2]
    if function.startswith("xǁ"):
        return ".".join((module, *function.removeprefix("xǁ").split("ǁ")))
    return f"{module}.{function.removeprefix('x_')}"


def changed_line(diff: str) -> str:
    """The line or lines that a mutant makes, from `mutmut show`; as one line.

    Of one that makes none, those that it takes away.
    """
    added, gone = (
        [line[1:].strip() for line in diff.splitlines() if re.match(rf"\{sign}(?!\{sign})", line)]
        for sign in "+-"
    )
    return " ".join(added) or f"without {' '.join(gone)}"


def counts_of(ends: Iterable[str]) -> str:
    """How many mutants came to which end, in words."""
    counts = Counter(ends)
    named = ", ".join(f"{count} {end}" for end, count in counts.most_common())
    return f"{counts.total()} mutants: {named}" if named else "0 mutants"


def render(results: Mapping[str, ModuleResult]) -> str:
    """RESULT.txt whole; `read` gets it back."""
    lines = []
    for _, result in sorted(results.items()):
        lines += [f"{result.path} {result.blob}", f"    {result.counts}"]
        lines += [f"    {one.where}: {one.line}" for one in sorted(set(result.survivors))]
    return "\n".join(lines) + "\n"


def read(text: str) -> dict[str, ModuleResult]:
    """The results of RESULT.txt, by path."""
    results: dict[str, ModuleResult] = {}
    lines = iter(text.splitlines())
    path = ""
    for line in lines:
        if module := _MODULE.match(line):
            path = module["path"]
            results[path] = ModuleResult(path, module["blob"], next(lines).strip())
        elif survivor := _SURVIVOR.match(line):
            before = results[path]
            mutant = Mutant(survivor["where"], survivor["line"])
            results[path] = ModuleResult(
                path, before.blob, before.counts, (*before.survivors, mutant)
            )
        else:
            raise ValueError(f"RESULT.txt has a line that is none of its own: {line!r}")
    return results


def blob_of(file: Path) -> str:
    """git's name for the contents of a file."""
    content = file.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()


def mutated_modules(root: Path, patterns: Iterable[str]) -> list[str]:
    """Paths below `root` of the modules that have code to mutate, from mutmut's `only_mutate`."""
    files = {file for pattern in patterns for file in root.glob(pattern)}
    return sorted(
        file.relative_to(root).as_posix() for file in files if "def " in file.read_text("utf-8")
    )


def unfinished(
    results: Mapping[str, ModuleResult],
    blobs: Mapping[str, str],
    before: Mapping[str, ModuleResult],
) -> list[str]:
    """Modules whose mutants were not tried on today's code, and survivors that are new.

    blobs: today's, by path. before: the results of the last run but this.
    """
    known = {one for result in before.values() for one in result.survivors}
    found = {one for result in results.values() for one in result.survivors}
    return [
        *(f"not tried: {path}" for path in sorted(blobs.keys() - results.keys())),
        *(
            f"changed since its mutants were tried: {path}"
            for path, result in sorted(results.items())
            if blobs.get(path) != result.blob
        ),
        *(f"survives now: {one.where}: {one.line}" for one in sorted(found - known)),
    ]


def _module_of(name: str) -> str:
    return name.rpartition("__mutmut_")[0].rpartition(".")[0]
