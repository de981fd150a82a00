"""What a session's log keeps, and the fields that many of its records have.

Each field of such a record, and of what is in it, is described once, where it stands:
`Annotated[int, "what it is [unit]"]`. Viewers show the text beside the value (`recording/codec.py`)
and `log fields` is made of it. `null` there is None here.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias


class Record:
    """Base of the frozen dataclasses that a session's log accepts."""

    __slots__ = ()


TimeNs: TypeAlias = Annotated[int, "when, on the session's monotonic clock [ns]"]
CaptureNs: TypeAlias = Annotated[int, "when the camera had the frame [ns]"]
FrameIndex: TypeAlias = Annotated[
    int, "number of the capture; in a log of `operate` its RTP timestamp"
]
ViewName: TypeAlias = Annotated[str, "name of the view"]
