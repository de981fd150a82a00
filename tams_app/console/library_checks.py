"""The checks of `doctor` for Python libraries; they need none of these themselves."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import tomllib
import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tams_app.console.findings import Finding, tried
from tams_app.runtime.process import PROJECT_DIRECTORY

if TYPE_CHECKING:
    from tams_app.config import Config

_PROJECT = PROJECT_DIRECTORY / "pyproject.toml"
_BOUND = re.compile(r"(>=|<)[ '\"]*([\d.]+)")  # no others are declared

# All that a session loads, in a child; its last line says what failed, and where.
_LOAD = """
import sys
from tams_app.console.library_checks import described
try:
    import tams_app.cli, tams_app.console.app
except BaseException as error:
    sys.exit(described(error))
"""


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
    """Whether all that a session needs can be imported: an installed library may be broken."""
    reason = tried(_LOAD)
    fix = "install that library anew, in a checkout with make setup; if none is named, report this"
    yield Finding("Loading TAMS", not reason, reason, fix)


def _requirements(extra: str) -> list[str]:
    """What the project declares for this Python: in its own file, or in its installed metadata."""
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
    """Whether it is at least what each `>=` names, and below what each `<` names."""
    found = _BOUND.findall(bounds)
    return all((_numbers(version) >= _numbers(one)) == (sign == ">=") for sign, one in found)


def _numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]
