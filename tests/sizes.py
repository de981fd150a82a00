"""`python -m tests.sizes [--write]`: what there is, against the ceilings of sizes.toml.

It prints the table, and fails above a ceiling. `--write` sets each ceiling to what there is.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import typer
from pydantic import BaseModel

from tams_app.cli import app
from tams_app.config.section import sections
from tams_app.config.whole import Config

ROOT = Path(__file__).parent.parent
CEILINGS = ROOT / "sizes.toml"
PRODUCT = ("tams_app", "hw", "calibration", "run_tams.py")


def sizes() -> dict[str, dict[str, int]]:
    """What there is, by table and row of sizes.toml."""
    tracked = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0")
    files = [path for name in tracked if name and (path := ROOT / name).is_file()]
    return {"lines": _lines(files), "counts": _counts(files)}


def _lines(files: list[Path]) -> dict[str, int]:
    """Lines of Python by package, and in all of product, tests and benchmarks; of JavaScript."""
    lines: Counter[str] = Counter()
    for path in files:
        if path.suffix == ".js":
            top = path.relative_to(ROOT).parts[0]
            lines[f"JavaScript in {top}"] += len(path.read_text("utf-8").splitlines())
        if path.suffix == ".py" and not path.is_symlink():
            parts = path.relative_to(ROOT).parts
            count = len(path.read_text("utf-8").splitlines())
            if parts[0] in PRODUCT:
                lines["product"] += count
                lines["/".join(parts[:2]) if len(parts) > 2 else "product, single modules"] += count
            else:
                lines[parts[0]] += count
    return dict(sorted(lines.items()))


def _counts(files: list[Path]) -> dict[str, int]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    named = (re.match(r"[\w-]+", line) for line in project["dependencies"] if "!=" not in line)
    return {
        "words of documents": sum(
            any(map(str.isalnum, word))
            for path in files
            if path.suffix == ".md" and not path.is_symlink()
            for word in path.read_text("utf-8").split()
        ),
        "core dependencies": len({one.group() for one in named if one}),
        "configuration keys": _keys(Config),
        "command-line options": _options(typer.main.get_command(app)),
        "kB of tracked files": sum(path.lstat().st_size for path in files) // 1000,
    }


def _keys(model: type[BaseModel]) -> int:
    """Keys that hold a value, of a section and of those below it, each kind of section once."""
    models, todo, keys = {model}, [model], 0
    while todo:
        for field in todo.pop().model_fields.values():
            below = set(sections(field.annotation))
            keys += not below
            todo += below - models
            models |= below
    return keys


def _options(command: object) -> int:
    """Options of a command and of those below it, without --help."""
    here = [one for one in getattr(command, "params", ()) if one.param_type_name == "option"]
    below = getattr(command, "commands", {}).values()
    return sum(one.name != "help" for one in here) + sum(map(_options, below))


def main(arguments: list[str]) -> str | None:
    """Print the table; what is above its ceiling, as the exit code and message, or None."""
    there = sizes()
    if arguments == ["--write"]:
        _write(there)
    ceilings = tomllib.loads(CEILINGS.read_text("utf-8"))
    above = []
    for table, rows in there.items():
        for name, size in rows.items():
            ceiling = ceilings[table].get(name, 0)
            sys.stdout.write(f"{size:7} of {ceiling:7}  {name}\n")
            if size > ceiling:
                above.append(f"{name}: {size}, the ceiling is {ceiling}")
    return "\n".join(above) or None


def _write(there: dict[str, dict[str, int]]) -> None:
    """Set the ceilings in the file, whose other lines stay."""
    text = CEILINGS.read_text("utf-8")
    for table, rows in there.items():
        body = "".join(f'"{name}" = {size}\n' for name, size in rows.items())
        text = re.sub(rf"(?ms)^\[{table}\]\n.*?(?=^$)", f"[{table}]\n{body}", text)
    CEILINGS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
