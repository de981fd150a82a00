"""Damaged frames in a capture chain: found before and behind its decoder, and left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hw.gstreamer import jpeg
from tams_app import gst


class DamageGate:
    """Lets whole frames pass: damaged ones, and what is predicted from them, are left out.

    Damaged is what a driver, network or decoder marks as corrupted, what is predicted across a gap,
    and a JPEG that lacks a part or of which no picture is made; then all up to the next keyframe. A
    decoder's frames are no longer marked as keyframes: behind a damaged one all are left out up to
    the time of the first keyframe that reaches the decoder afterwards.
    Decoders do not tell what they fill in: jpegdec and avdec_h264 (1.22) mark and report nothing,
    and avdec_mjpeg, which logs it, ends the process for one wrong byte of a picture's header.
    """

    def __init__(self, pipeline: Any, sink: Any, fail: Callable[[str], None]) -> None:
        """Of a pipeline that ends in `sink`, before it plays; `fail` receives errors in here."""
        self.damaged = 0  # frames left out so far
        self.cause = ""  # of the newest of them
        self.lacks = ""  # what keeps it from finding damage: the end of a camera's sentence
        self._broken = False
        self._is_undecoded = False  # the newest JPEG, so far
        self._is_predicted = False  # what is decoded, from frames before it
        self._whole_from_ns: int | None = 0  # decoded frames; None: a keyframe must come first
        self._fail = fail
        Gst = gst.load().Gst
        pipeline.connect("deep-element-added", lambda *added: self._watch(added[-1]))
        elements = pipeline.iterate_recurse()
        while (found := elements.next())[0] == Gst.IteratorResult.OK:
            self._watch(found[1])
        pad = sink.get_static_pad("sink")
        gst.add_probe(pad, Gst.PadProbeType.BUFFER, self._on_frame, fail)

    def _watch(self, element: Any) -> None:
        klass = element.get_metadata("klass")
        if "Decoder" in klass and ("Video" in klass or "Image" in klass):
            pad = element.get_static_pad("sink")
            gst.add_probe(pad, gst.load().Gst.PadProbeType.BUFFER, self._on_coded, self._fail)

    def _on_coded(self, pad: Any, probe: Any) -> Any:
        Gst = gst.load().Gst
        flags, buffer = Gst.BufferFlags, probe.get_buffer()
        if buffer.pts == Gst.CLOCK_TIME_NONE:  # not one frame, perhaps; the capture refuses it
            return Gst.PadProbeReturn.OK
        is_jpeg = pad.get_current_caps().get_structure(0).get_name() == "image/jpeg"
        if self._is_undecoded:
            self._leave_out("JPEG pictures cannot be decoded")
        was_broken, self._broken, self._is_undecoded = self._broken, True, False
        if is_jpeg and jpeg.turbojpeg() is None:
            self.lacks = jpeg.LACKS
        if is_jpeg and (damage := jpeg.damage_of(gst.pixels_of(buffer).tobytes())):
            return self._leave_out(damage)
        if buffer.has_flags(flags.CORRUPTED):  # jpegparse 1.26 marks damaged pictures, too
            return self._leave_out("the driver or the network marks them as incomplete")
        if buffer.has_flags(flags.DELTA_UNIT) and (was_broken or buffer.has_flags(flags.DISCONT)):
            return self._leave_out(self.cause if was_broken else "frames before them are missing")
        self._broken, self._is_undecoded, self._is_predicted = False, is_jpeg, not is_jpeg
        whole_from_ns = self._whole_from_ns
        if not buffer.has_flags(flags.DELTA_UNIT) and (
            whole_from_ns is None or buffer.pts < whole_from_ns  # a file that begins again
        ):
            self._whole_from_ns = buffer.pts
        return Gst.PadProbeReturn.OK

    def _on_frame(self, _pad: Any, probe: Any) -> Any:
        Gst, buffer = gst.load().Gst, probe.get_buffer()
        self._is_undecoded = False
        if buffer.has_flags(Gst.BufferFlags.CORRUPTED):
            if self._is_predicted:
                self._whole_from_ns = None
            return self._leave_out("the driver or the decoder marks them as incomplete")
        whole_from_ns = self._whole_from_ns
        if whole_from_ns is None or buffer.pts < whole_from_ns:
            return self._leave_out(self.cause)
        self._whole_from_ns = 0
        return Gst.PadProbeReturn.OK

    def _leave_out(self, cause: str) -> Any:
        self.damaged += 1
        self.cause = cause
        return gst.load().Gst.PadProbeReturn.DROP
