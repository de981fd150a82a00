"""Why the controller model does not do what it is asked."""

from __future__ import annotations

from hw.lite6.codes import ErrorCode


class MotionError(Exception):
    """Motion that the controller refuses; it stops with this error code."""

    def __init__(self, code: ErrorCode) -> None:
        super().__init__(f"controller error C{code.value}: {code.name.lower()}")
        self.code = code


class CommandError(Exception):
    """A request the controller cannot make sense of; it changes nothing."""
