"""What a session's log keeps, the fields that many of its records have, poses and velocities.

Each field of such a record, and of what is in it, is described once, where it stands:
`Annotated[int, "what it is [unit]"]`. Viewers show the text beside the value (`recording/codec.py`)
and `log fields` is made of it. `null` there is None here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3


class Record:
    """Base of the frozen dataclasses that a session's log accepts."""

    __slots__ = ()


TimeNs: TypeAlias = Annotated[int, "when, on the session's monotonic clock [ns]"]
CaptureNs: TypeAlias = Annotated[int, "when the camera had the frame [ns]"]
FrameIndex: TypeAlias = Annotated[
    int, "number of the capture; in a log of `operate` its RTP timestamp"
]
ViewName: TypeAlias = Annotated[str, "name of the view"]
Vector: TypeAlias = NDArray[np.float64]

T = TypeVar("T", bound=Record)


class Newest:
    """The newest record of each type; any thread puts and takes."""

    def __init__(self, records: Iterable[Record | None] = ()) -> None:
        """`records`: one of each type, or None where there was none yet."""
        self._records: dict[type[Record], Record] = {
            type(one): one for one in records if one is not None
        }

    def put(self, record: Record) -> None:
        """In place of the one before of its type."""
        self._records[type(record)] = record

    def of(self, kind: type[T]) -> T | None:
        """The newest of this type; None before the first."""
        found = self._records.get(kind)
        return found if isinstance(found, kind) else None


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame in its parent frame."""

    position: Annotated[Vector, "x, y, z [m]"]
    rotation: Annotated[Rotation, "quaternion x, y, z, w"]


@dataclass(frozen=True, slots=True)
class Twist:
    """A velocity in the arm's base frame."""

    linear: Annotated[Floats3, "velocity x, y, z [m/s]"]
    angular: Annotated[Floats3, "angular velocity x, y, z [rad/s]"]

    @staticmethod
    def zero() -> Twist:
        return Twist(ZERO, ZERO)

    @property
    def is_zero(self) -> bool:
        return not (any(self.linear) or any(self.angular))
