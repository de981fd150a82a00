"""The checks of `doctor` for Python libraries; they need none of these themselves."""

from __future__ import annotations

import importlib.metadata
import tomllib
import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tams_app.console.findings import Finding, tried
from tams_app.runtime.process import PROJECT_DIRECTORY

if TYPE_CHECKING:
    from packaging.requirements import Requirement

    from tams_app.config import Config

_PROJECT = PROJECT_DIRECTORY / "pyproject.toml"

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
    published = config is not None and config.recording.ros2 is not None
    try:
        wanted = _requirements("ros2" if published else "")
    except Exception as error:  # noqa: BLE001  whatever a broken library raises
        yield Finding("Python libraries", False, f"packaging: {error}", "make setup")
        return
    missing = [package for requirement in wanted if (package := _missing(requirement))]
    detail = f"missing: {', '.join(missing)}" if missing else f"{len(wanted)} found"
    names = " ".join(f"'{requirement}'" for requirement in missing)
    yield Finding("Python libraries", not missing, detail, f"make setup, or pip install {names}")


def loading(_: Config | None = None) -> Iterator[Finding]:
    """Whether all that a session needs can be imported: an installed library may be broken."""
    reason = tried(_LOAD)
    fix = "install that library anew, in a checkout with make setup; if none is named, report this"
    yield Finding("Loading TAMS", not reason, reason, fix)


def _requirements(extra: str) -> list[Requirement]:
    """The project's declared packages: from its own file, or from its installed metadata."""
    from packaging.requirements import Requirement

    if _PROJECT.is_file():
        project = tomllib.loads(_PROJECT.read_text(encoding="utf-8"))["project"]
        lines = [*project["dependencies"], *project["optional-dependencies"].get(extra, [])]
    else:
        lines = importlib.metadata.requires("tams") or []
    requirements = map(Requirement, lines)
    return [one for one in requirements if not one.marker or one.marker.evaluate({"extra": extra})]


def _missing(requirement: Requirement) -> str:
    """The requirement as pip takes it if it is not met, else ""."""
    try:
        installed = importlib.metadata.version(requirement.name)
    except importlib.metadata.PackageNotFoundError:
        installed = None
    met = installed is not None and requirement.specifier.contains(installed, prereleases=True)
    return "" if met else f"{requirement.name}{requirement.specifier}"
