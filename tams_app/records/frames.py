"""Frames, from the camera to the operator's screen."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.records.record import CaptureNs, FrameIndex, Record, TimeNs, ViewName

Image: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class TaskRegion:
    """The disc of a picture that the gripper and what it handles are in."""

    x_px: float
    y_px: float
    radius_px: float


@dataclass(frozen=True, slots=True)
class Frame(Record):
    """A captured frame: BGR, shape (height, width, 3); `index` counts captures of its view.

    damaged: frames of its view that arrived damaged since the one before, and were left out.
    """

    view: str
    index: int
    capture_ns: int
    image: Image
    ready_ns: int = 0  # the camera, or the rig's renderer, had made the picture; 0: not known
    damaged: int = 0


@dataclass(frozen=True, slots=True)
class EncodedFrame(Record):
    """A frame as it left the encoder: H.264 Annex B bytes of one access unit."""

    view: str
    index: int
    capture_ns: int
    encoded_ns: int
    keyframe: bool
    data: bytes
    pushed_ns: int = 0  # handed to the sender; 0 in logs that do not say
    rtp_timestamp: int | None = None  # of its packets; None in logs that do not say
    ready_ns: int = 0  # as in `Frame`


@dataclass(frozen=True, slots=True)
class CameraRates(Record):
    """How many frames a second the cameras gave lately."""

    t_ns: TimeNs
    given_fps: Annotated[
        dict[str, float], "by view, frames that came in the last second [1/s]; first record: empty"
    ]
    overrun_fps: Annotated[
        dict[str, float], "by view, frames that came besides and were not taken [1/s]"
    ]
    damaged: Annotated[
        dict[str, int], "by view, frames that arrived damaged in the last second; left out"
    ] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DroppedFrame(Record):
    """A captured frame that was left out at the source because its target was below 80 kbit/s."""

    view: ViewName
    index: FrameIndex
    capture_ns: CaptureNs
    under_way: Annotated[bool, "left out since too much was in flight, not for its target"] = False


@dataclass(frozen=True, slots=True)
class ShownFrame(Record):
    """A decoded frame that reached the receiver's mailbox: BGR, shape (height, width, 3)."""

    view: str
    index: int  # capture index, exact also under loss
    shown_ns: int
    image: Image
    capture_ns: int
    whole: bool  # no packet of it, or of what it is predicted from, was missing
    received_ns: int = 0  # the jitter buffer had handed out its last packet; 0: not known


@dataclass(frozen=True, slots=True)
class SteeredBy:
    """The newest frame of one view that counts for the operator; both None before the first.

    `is_damaged`: the operator sees a newer one, which does not count because it is not whole.
    """

    index: int | None = None
    capture_ns: int | None = None
    is_damaged: bool = False


@dataclass(frozen=True, slots=True)
class FrameQuality(Record):
    """What became of one captured frame; scores compare with the frame as it was captured."""

    view: ViewName
    index: FrameIndex
    capture_ns: CaptureNs
    shown_ns: Annotated[int | None, "when the decoded frame reached the screen [ns]; null: never"]
    age_ns: Annotated[
        int | None,
        "age of what was on the screen at capture [ns]; null: nothing, or not known",
    ]
    frozen: Annotated[bool, "whether what was on the screen had stayed there too long"]
    concealed: Annotated[
        bool | None, "whether the decoder filled in for lost data; null: not known"
    ]
    received: Annotated[float | None, "SSIM of the frame as shown, 0 to 1; null: not computed"]
    delivered: Annotated[
        float | None,
        "SSIM of what stood in its place (itself, or the frame shown before it), 0 to 1; null: not "
        "computed",
    ]
    live: Annotated[
        float | None, "SSIM of what was on the screen at capture, 0 to 1; null: not computed"
    ]
    task_received: Annotated[
        float | None,
        "as `received`, within the task's region at capture; null: not computed, or the task is "
        "not known to be in sight",
    ] = None
    task_delivered: Annotated[float | None, "as `delivered`, within the same region"] = None
    task_live: Annotated[float | None, "as `live`, within the same region"] = None
