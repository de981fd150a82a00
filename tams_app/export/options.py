"""Options of an export, of whatever format."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExportOptions:
    """What is to be written of the sessions.

    task: what they show, in words. only_success: leave out those that were not judged a success.
    keep_idle: also the time before the first engagement and after the placing. with_damaged: of a
    log that is not whole, the longest part that is.
    """

    task: str = "Pick up the block and place it in the container."
    only_success: bool = False
    keep_idle: bool = False
    with_damaged: bool = False
