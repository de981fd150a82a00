"""Frames, from the camera to the operator's screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Frame:
    """A captured frame: BGR, shape (height, width, 3); `index` counts captures of its view."""

    view: str
    index: int
    capture_ns: int
    image: Image


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """A frame as it left the encoder: H.264 Annex B bytes of one access unit."""

    view: str
    index: int
    capture_ns: int
    encoded_ns: int
    keyframe: bool
    data: bytes
    pushed_ns: int = 0  # handed to the sender; 0 in logs that do not say
    rtp_timestamp: int | None = None  # of its packets; None in logs that do not say


@dataclass(frozen=True, slots=True)
class CameraRates:
    """How many frames a second the cameras gave lately, and what is asked of them from now on."""

    t_ns: int
    asked_fps: float  # less than the header's `fps` while the rig's cameras are stepped down
    reason: str  # why `asked_fps` is another one from now on, "" if it is not
    given_fps: dict[str, float]  # by view, over the last second; empty in the first record
    overrun_fps: dict[
        str, float
    ]  # frames that a camera had besides, which the session did not take


@dataclass(frozen=True, slots=True)
class DroppedFrame:
    """A captured frame that was left out at the source because its target was below 80 kbit/s."""

    view: str
    index: int
    capture_ns: int
    under_way: bool = False  # because too much was on its way over the link, instead


@dataclass(frozen=True, slots=True)
class ShownFrame:
    """A decoded frame that reached the receiver's mailbox: BGR, shape (height, width, 3)."""

    view: str
    index: int  # capture index, exact also under loss
    shown_ns: int
    image: Image
    capture_ns: int
    whole: bool  # no packet of it, or of what it is predicted from, was missing


@dataclass(frozen=True, slots=True)
class SteeredBy:
    """The newest frame of one view that counts for the operator; both None before the first.

    `is_damaged`: the operator sees a newer one, which does not count because it is not whole.
    """

    index: int | None = None
    capture_ns: int | None = None
    is_damaged: bool = False


@dataclass(frozen=True, slots=True)
class FrameQuality:
    """What became of one captured frame. Scores are SSIM, None where they were not computed.

    `age_ns`: of what was on screen when it was captured (None: nothing, or not known);
    `frozen`: that frame stayed too long (`freeze_ns`); `concealed`: the decoder filled
    in for lost data, None where this is not known live.
    """

    view: str
    index: int
    capture_ns: int
    shown_ns: int | None  # None: never shown
    age_ns: int | None
    frozen: bool
    concealed: bool | None
    received: float | None  # the frame as shown against itself as captured
    delivered: float | None  # what stands for it: itself, or the frame shown before it
    live: float | None  # what was on screen when it was captured, against it
