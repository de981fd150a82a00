"""The errors a person may meet, each one sentence that says what to do.

TamsError
├── ConfigError      wrong use, configuration or input   (exit code 2)
├── SetupError       the machine lacks something         (exit code 1)
├── DeviceError      a device or its link failed         (exit code 1)
├── HelperError      a helper process died or is silent  (exit code 1)
├── LogError         a log cannot be written             (exit code 1)
│   └── UnreadableLogError  what was given is no log     (exit code 2)
└── SignalledError   Ctrl-C or a signal ended it         (exit code 130)
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path

_EXTRAS = {
    "ros2": ("cyclonedds", "rosbags"),
    "export": ("av", "pyarrow"),
    "study": ("pandas", "pyarrow", "statsmodels"),
    "dask": ("distributed",),
}
_IS_CHECKOUT = (Path(__file__).parents[1] / "setup.sh").is_file()


def not_one_of(word: str, choices: Iterable[str]) -> str:
    """What is wrong with a `word` that is none of the `choices`, with the one it resembles."""
    choices = list(choices)
    by_folded = {choice.casefold(): choice for choice in choices}
    close = get_close_matches(word.casefold(), by_folded, 1)
    meant = f"; did you mean {by_folded[close[0]]}?" if close else ""
    return f"{word!r} is not one of {', '.join(choices)}{meant}"


class TamsError(Exception):
    """Base of all errors that are shown to the user as one sentence."""

    exit_code = 1


class ConfigError(TamsError):
    """The command line, a configuration file or another input file is wrong."""

    exit_code = 2


class SetupError(TamsError):
    """Something that TAMS needs is missing on this machine."""


class DeviceError(TamsError):
    """An arm, a controller or a camera refused, failed or went silent."""


class HelperError(TamsError):
    """A helper process could not be started or ended unasked."""


class LogError(TamsError):
    """A session log, or another result, cannot be written."""


class UnreadableLogError(LogError):
    """A file or folder that was given holds no session log that can be read."""

    exit_code = 2


class SignalledError(TamsError):
    """A signal, such as Ctrl-C, ended a command that stops its arm in order before it ends."""

    exit_code = 130


def require_extra(extra: str, what: str) -> None:
    """SetupError on what installs the packages of an extra unless they are there; imports none."""
    missing = [name for name in _EXTRAS[extra] if find_spec(name) is None]
    if missing:
        how = "make extras" if _IS_CHECKOUT else f"pip install 'tams[{extra}]'"
        raise SetupError(f"{what} needs {' and '.join(missing)}: {how}")
