"""The errors a person may meet, each one sentence that says what to do.

TamsError
├── ConfigError      wrong use or configuration          (exit code 2)
├── SetupError       the machine lacks something         (exit code 1)
├── DeviceError      a device or its link failed         (exit code 1)
├── HelperError      a helper process died or is silent  (exit code 1)
└── LogError         a log cannot be written or read     (exit code 1)
"""

from __future__ import annotations


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
    """A session log cannot be written or read."""
