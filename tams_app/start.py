"""The entry of the command line, with an explanation where it cannot be loaded."""

from __future__ import annotations

import sys
from importlib import import_module


def main() -> None:
    """Run the command line; ends the process as `tams_app.cli.main` does."""
    try:
        from tams_app.cli import main as run  # takes a second, in which Ctrl-C counts too

        if _is_doctor():
            import_module("tams_app.console.doctor")
    except KeyboardInterrupt:
        _say("tams: interrupted", error=True)
        sys.exit(130)
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        sys.exit(_explain(error))
    run()


def _is_doctor() -> bool:
    return sys.argv[1:2] == ["doctor"]


def _explain(error: Exception) -> int:
    from tams_app.console.findings import described, libraries, loading, verdict

    if not _is_doctor():
        reason = described(error)
        _say(f"tams: cannot be loaded, {reason}: `doctor` says what is missing", error=True)
        return 1
    found = [*libraries(), *loading()]
    for finding in found:
        _say(str(finding))
    _say(verdict(sum(finding.is_broken for finding in found)))
    return 1


def _say(line: str, error: bool = False) -> None:
    print(line, file=sys.stderr if error else sys.stdout)
