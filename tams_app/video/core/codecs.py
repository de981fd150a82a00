"""The encoders and decoders that a session can use: how each is set up, and what it can change.

Adding one takes an entry here and its word in `VideoConfig`. Names of settings differ between the
versions of an element: `codec_probe` leaves out those that it does not have here.
"""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import VideoConfig


@dataclass(frozen=True, slots=True)
class Encoder:
    """An H.264 encoder, set up to give each frame at once: no B frames, no lookahead, CBR.

    In `settings` and `rate`, `{kbps}` and `{bps}` stand for the bitrate, `{preset}`, `{vbv_ms}` and
    `{keyframe_interval}` for the keys of the configuration.
    """

    word: str  # in the configuration
    element: str
    settings: tuple[str, ...]  # `name=value`, as gst-launch takes them
    rate_property: str = "bitrate"  # what is set while it plays,
    rate: str = "{kbps}"  # and its value
    caps: str = "profile=high,"
    pixels: str = "NV12"
    holds_each_frame: bool = False
    """Whether its rate buffer is one frame at any bitrate, so that none is larger than its share"""
    adjustable: bool = True  # the element here lets its rate be set while it plays

    def launch(self, config: VideoConfig, kbps: int) -> str:
        """I420 frames in, H.264 out; the converter only hands I420 on."""
        settings = " ".join(self.settings).format(
            kbps=kbps,
            bps=kbps * 1000,
            preset=config.preset,
            vbv_ms=round(config.vbv_ms),
            keyframe_interval=config.keyframe_interval,
        )
        return (
            f"videoconvert name=converter n-threads=1 ! video/x-raw,format={self.pixels} "
            f"! {self.element} name=encoder {settings} "
            f"! video/x-h264,{self.caps}stream-format=byte-stream,alignment=au"
        )

    def rate_text(self, kbps: int) -> str:
        """The value of `rate_property` for a bitrate."""
        return self.rate.format(kbps=kbps, bps=kbps * 1000)


@dataclass(frozen=True, slots=True)
class Decoder:
    """An H.264 decoder."""

    word: str  # in the configuration
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


# threads=1: anything else is not deterministic. aud=false saves a fifth of the packets.
X264 = Encoder(
    "x264",
    "x264enc",
    (
        "tune=zerolatency",
        "threads=1",
        "speed-preset={preset}",
        "bitrate={kbps}",
        "vbv-buf-capacity={vbv_ms}",
        "key-int-max={keyframe_interval}",
        "aud=false",
    ),
    pixels="I420",
    holds_each_frame=True,  # its buffer is set in ms
)
AVDEC = Decoder("avdec", "avdec_h264", ("max-threads=1",))

# The rate buffers of the others are set in kbit: `vbv-buffer-size` of the older nvh264enc only
# before it plays, `cpb-size` of vah264enc at least half a second. They keep their own: `Overdraft`.
ENCODERS = {
    encoder.word: encoder
    for encoder in (
        Encoder(
            "nvh264",
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
            "vah264",
            "vah264enc",
            (
                "rate-control=cbr",
                "bitrate={kbps}",
                "b-frames=0",
                "key-int-max={keyframe_interval}",
                "aud=false",
            ),
        ),
        # The names are the kernel's. They can be set while it plays since GStreamer 1.27.
        Encoder(
            "v4l2h264",
            "v4l2h264enc",
            (
                'extra-controls="controls,video_bitrate_mode=1,video_bitrate={bps},'
                'video_gop_size={keyframe_interval},video_b_frames=0,repeat_sequence_header=1"',
            ),
            rate_property="extra-controls",
            rate="controls,video_bitrate={bps}",
            caps="level=(string)4,",  # some drivers refuse without one
        ),
        X264,
    )
}
DECODERS = {
    decoder.word: decoder
    for decoder in (
        Decoder("nvh264dec", "nvh264dec", ("max-display-delay=0",)),
        Decoder("vah264dec", "vah264dec"),
        AVDEC,
    )
}


@dataclass(frozen=True, slots=True)
class Codecs:
    """The codecs of one session, and remarks where they are not those that were asked for."""

    encoder: Encoder
    decoder: Decoder
    remarks: tuple[str, ...] = ()


SOFTWARE = Codecs(X264, AVDEC)
