"""The encoders and decoders that a session can use, how each is set up, and the frames they take.

Adding one takes an entry here and its word in `VideoConfig`. Names of settings differ between the
versions of an element: `installed_codecs` leaves out those that it does not have here.

Frames are converted by OpenCV in place of GStreamer's videoconvert, BGR to I420 and back (BT.601):
a fifth of its time there and two fifths back, and what comes back is nearer to what entered, by
4 dB or more (`benchmarks.colour` at 628dd78b). The chroma of four pixels is that of the upper left
one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.config import VideoConfig
from tams_app.records import Image

Planes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Encoder:
    """An H.264 encoder, set up to give each frame at once: no B frames, no lookahead, CBR.

    Its `bitrate` [kbit/s] can be set while it plays. In `settings`, `{kbps}` stands for it,
    `{preset}` and `{keyframe_interval}` for the keys of the configuration.
    """

    element: str
    settings: tuple[str, ...]  # `name=value`, as gst-launch takes them
    pixels: str = "NV12"

    def launch(self, config: VideoConfig, kbps: int) -> str:
        """I420 frames in, H.264 out; the converter only hands I420 on."""
        settings = " ".join(self.settings).format(
            kbps=kbps,
            preset=config.preset,
            keyframe_interval=config.keyframe_interval,
        )
        return (
            f"videoconvert name=converter n-threads=1 ! video/x-raw,format={self.pixels} "
            f"! {self.element} name=encoder {settings} "
            "! video/x-h264,profile=high,stream-format=byte-stream,alignment=au"
        )


@dataclass(frozen=True, slots=True)
class Decoder:
    element: str
    settings: tuple[str, ...] = ()

    @property
    def launch(self) -> str:
        """H.264 in, I420 out; the converter is for decoders that give something else."""
        settings = "".join(f" {setting}" for setting in self.settings)
        return (
            f"{self.element} name=decoder{settings} "
            "! videoconvert n-threads=1 ! video/x-raw,format=I420"
        )


# threads=1: anything else is not deterministic. aud=false saves a fifth of the packets. 33 ms are
# one frame, at any rate; with more than 36 x264 no longer holds each frame to it.
X264 = Encoder(
    "x264enc",
    (
        "tune=zerolatency",
        "threads=1",
        "speed-preset={preset}",
        "bitrate={kbps}",
        "vbv-buf-capacity=33",
        "key-int-max={keyframe_interval}",
        "aud=false",
    ),
    pixels="I420",
)
AVDEC = Decoder("avdec_h264", ("max-threads=1",))

# The rate buffers of the others are set in kbit: `vbv-buffer-size` of the older nvh264enc only
# before it plays, `cpb-size` of vah264enc at least half a second. They keep their own.
ENCODERS = {
    encoder.element: encoder
    for encoder in (
        X264,
        Encoder(
            "nvh264enc",
            (
                "preset=low-latency-hq",
                "rc-mode=cbr",
                "bitrate={kbps}",
                "bframes=0",
                "b-frames=0",  # the same in newer versions
                "b-adapt=false",
                "rc-lookahead=0",
                "zerolatency=true",
                "zero-reorder-delay=true",  # the same in newer versions
                "gop-size={keyframe_interval}",
                "aud=false",
            ),
        ),
        Encoder(
            "vah264enc",
            (
                "rate-control=cbr",
                "bitrate={kbps}",
                "b-frames=0",
                "key-int-max={keyframe_interval}",
                "aud=false",
            ),
        ),
    )
}
DECODERS = {
    decoder.element: decoder
    for decoder in (
        AVDEC,
        Decoder("nvh264dec", ("max-display-delay=0",)),
        Decoder("vah264dec"),
    )
}


@dataclass(frozen=True, slots=True)
class Codecs:
    encoder: Encoder
    decoder: Decoder


SOFTWARE = Codecs(X264, AVDEC)


def i420_of(image: Image) -> Planes:
    """Y, U and V one after the other, shape (3/2 height, width), of a BGR image.

    Rows have no padding, as GStreamer lays them out for widths that are multiples of 8.
    """
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), np.uint8)


def bgr_of(planes: Planes, height: int, width: int) -> Image:
    """The BGR image, shape (height, width, 3), of a frame's I420 planes in any shape."""
    stacked = planes.reshape(height * 3 // 2, width)
    return np.asarray(cv2.cvtColor(stacked, cv2.COLOR_YUV2BGR_I420), np.uint8)
