"""The encoder and the decoder, how each is set up, and the frames they take.

Frames are converted by OpenCV in place of GStreamer's videoconvert, BGR to I420 and back (BT.601):
a fifth of its time there and two fifths back, and what comes back is nearer to what entered, by
4 dB or more (`benchmarks.colour` at 628dd78b). The chroma of four pixels is that of the upper left
one.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.config import VideoConfig
from tams_app.records import Image

Planes = NDArray[np.uint8]


ENCODER, DECODER = "x264enc", "avdec_h264"


def encoder_launch(config: VideoConfig, kbps: int) -> str:
    """I420 frames in, H.264 out; each frame at once: no B frames, no lookahead, CBR.

    `bitrate` [kbit/s] can be set while it plays. threads=1: anything else is not deterministic.
    aud=false saves a fifth of the packets. A rate buffer of 33 ms is one frame, at any rate; with
    more than 36 x264 no longer holds each frame to it. The converter only hands I420 on.
    """
    return (
        "videoconvert name=converter n-threads=1 ! video/x-raw,format=I420 "
        f"! {ENCODER} name=encoder tune=zerolatency threads=1 speed-preset={config.preset} "
        f"bitrate={kbps} vbv-buf-capacity=33 key-int-max={config.keyframe_interval} aud=false "
        "! video/x-h264,profile=high,stream-format=byte-stream,alignment=au"
    )


# H.264 in, I420 out
DECODER_LAUNCH = (
    f"{DECODER} name=decoder max-threads=1 ! videoconvert n-threads=1 ! video/x-raw,format=I420"
)


def i420_of(image: Image) -> Planes:
    """Y, U and V one after the other, shape (3/2 height, width), of a BGR image.

    Rows have no padding, as GStreamer lays them out for widths that are multiples of 8.
    """
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), np.uint8)


def bgr_of(planes: Planes, height: int, width: int) -> Image:
    """The BGR image, shape (height, width, 3), of a frame's I420 planes in any shape."""
    stacked = planes.reshape(height * 3 // 2, width)
    return np.asarray(cv2.cvtColor(stacked, cv2.COLOR_YUV2BGR_I420), np.uint8)
