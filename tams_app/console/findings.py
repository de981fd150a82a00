"""What the doctor finds; with nothing but Python's own library, so that it can always be stated."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tams_app.errors import TamsError
from tams_app.runtime.process import PROJECT_DIRECTORY

if TYPE_CHECKING:
    from tams_app.config import Config

TRIED_TIMEOUT_S = 60


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
    """Whether it can be done with what is `given`; what a TamsError says is how to fix it."""
    try:
        attempt(*given)
    except TamsError as error:
        return Finding(what, False, detail, str(error))
    return Finding(what, True, detail)


Check = Callable[["Config"], Iterator[Finding]]


def examine(config: Config, checks: Sequence[Check]) -> Iterator[Finding]:
    """What each check finds; one that cannot be made is a finding as well."""
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
