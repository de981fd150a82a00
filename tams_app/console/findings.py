"""The doctor's findings, and its checks for Python libraries.

All with nothing but Python's own library, so that it can always be stated.
"""

from __future__ import annotations

import importlib.metadata
import platform
import re
import subprocess
import sys
import tomllib
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tams_app.errors import TamsError
from tams_app.runtime.process import PROJECT_DIRECTORY

if TYPE_CHECKING:
    from tams_app.config import Config

TRIED_TIMEOUT_S = 60
_PROJECT = PROJECT_DIRECTORY / "pyproject.toml"
_BOUND = re.compile(r"(>=|<)[ '\"]*([\d.]+)")  # no others are declared

# All that a session loads, in a child; its last line says what failed, and where.
_LOAD = """
import sys
from tams_app.console.findings import described
try:
    import tams_app.cli, tams_app.console.app
except BaseException as error:
    sys.exit(described(error))
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at: whether it is there, if TAMS runs without it, and how to fix it."""

    what: str
    ok: bool
    detail: str = ""
    fix: str = ""
    essential: bool = True

    @property
    def is_broken(self) -> bool:
        """TAMS cannot run like this."""
        return self.essential and not self.ok

    def __str__(self) -> str:
        word = "ok     " if self.ok else "MISSING" if self.essential else "absent "
        detail = f" ({self.detail})" if self.detail else ""
        fix = "" if self.ok else f": {self.fix}"
        return f"{word} {self.what}{detail}{fix}"


def attempted(
    what: str, attempt: Callable[..., object], *given: object, detail: str = ""
) -> Finding:
    """Try something with what is `given`; the text of a TamsError is the fix."""
    try:
        attempt(*given)
    except TamsError as error:
        return Finding(what, False, detail, str(error))
    return Finding(what, True, detail)


Check = Callable[["Config"], Iterator[Finding]]


def examine(config: Config, checks: Sequence[Check]) -> Iterator[Finding]:
    """The findings of each check; one that cannot be made is a finding as well."""
    for check in checks:
        try:
            for found in check(config):
                yield replace(found, fix="") if found.ok else found
        except Exception as error:  # noqa: BLE001  a library that is missing or broken, for one
            name = check.__name__.replace("_", " ")
            fix = "fix what is missing above; if nothing is, report this line"
            yield Finding(f"Check of {name}", False, f"{type(error).__name__}: {error}", fix)


def verdict(broken: int) -> str:
    """The last line, below the findings."""
    if broken:
        return f"{broken} of these must be fixed before TAMS can run."
    return "All that TAMS needs is here."


def tried(code: str) -> str:
    """Run this Python in a child, as a broken driver may abort; its last words, "" if it worked."""
    command = [sys.executable, "-c", code]
    try:
        result = subprocess.run(
            command, cwd=PROJECT_DIRECTORY, capture_output=True, text=True, timeout=TRIED_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {TRIED_TIMEOUT_S} s"
    if not result.returncode:
        return ""
    last_words = result.stderr.strip().splitlines()[-1:] or [f"ended with {result.returncode}"]
    return last_words[0].removeprefix("tams_app.errors.SetupError: ")


def described(error: BaseException) -> str:
    """An error in one line: what it is, and where it was raised."""
    (*_, place) = traceback.extract_tb(error.__traceback__)
    words = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{words} ({place.filename}, line {place.lineno})"


def libraries(config: Config | None = None) -> Iterator[Finding]:
    """The Python packages that TAMS declares, and those of ROS 2 where a session is published."""
    extra = "ros2" if config is not None and config.recording.ros2 is not None else ""
    wanted = _requirements(extra)
    missing = [requirement for requirement in wanted if _is_missing(requirement)]
    detail = f"missing: {', '.join(missing)}" if missing else f"{len(wanted)} found"
    names = " ".join(f"'{requirement}'" for requirement in missing)
    fix = f"make {'extras' if extra else 'setup'}, or pip install {names}"
    yield Finding("Python libraries", not missing, detail, fix)


def loading(_: Config | None = None) -> Iterator[Finding]:
    """Import all that a session needs: an installed library may be broken."""
    reason = tried(_LOAD)
    fix = "install that library anew, in a checkout with make setup; if none is named, report this"
    yield Finding("Loading TAMS", not reason, reason, fix)


def _requirements(extra: str) -> list[str]:
    """The project's requirements for this Python, from its own file or its installed metadata."""
    if _PROJECT.is_file():
        project = tomllib.loads(_PROJECT.read_text(encoding="utf-8"))["project"]
        lines = [*project["dependencies"], *project["optional-dependencies"].get(extra, [])]
    else:
        lines = importlib.metadata.requires("tams") or []
    parts = [line.partition(";") for line in lines]
    return [one.strip() for one, _, marker in parts if _applies(marker, extra)]


def _applies(marker: str, extra: str) -> bool:
    if "extra ==" in marker:
        return f'"{extra}"' in marker
    return _within(platform.python_version(), marker)


def _is_missing(requirement: str) -> bool:
    try:
        installed = importlib.metadata.version(re.split("[<>=]", requirement)[0])
    except importlib.metadata.PackageNotFoundError:
        return True
    return not _within(installed, requirement)


def _within(version: str, bounds: str) -> bool:
    """True if it is at least what each `>=` names, and below what each `<` names."""
    found = _BOUND.findall(bounds)
    return all((_numbers(version) >= _numbers(one)) == (sign == ">=") for sign, one in found)


def _numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]
