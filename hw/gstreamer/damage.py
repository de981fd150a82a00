"""Damaged frames in a capture chain: found before and behind its decoder, and left out."""

from __future__ import annotations

import ctypes
import re
from functools import cache
from typing import Any

from tams_app import gst

LACKS = "is not watched for JPEGs that lack a part; install libturbojpeg0 (Ubuntu: libturbojpeg)"
_END, _SCAN = b"\xff\xd9", b"\xff\xda"  # markers: never within the data of a scan
_RESTART, _RESTARTS = re.compile(rb"\xff([\xd0-\xd7])"), bytes(range(0xD0, 0xD8))
# libjpeg's warnings of missing data. Not those of a few bytes too many before a marker: Logitech's
# cameras fill up restart intervals of whole pictures so, with up to 10 bytes as far as reported.
_DAMAGE = re.compile(rb"Premature end|Corrupt JPEG data: (?!(\d|1[0-6]) extraneous bytes)")
_GREY, _STOP_ON_WARNING, _WARNING, _SHRINK = 6, 8192, 0, 8  # turbojpeg.h; an eighth is the least


class DamageGate:
    """Lets whole frames pass: damaged ones, and what is predicted from them, are left out.

    Damaged is what a driver, network or decoder marks as corrupted, what is predicted across a gap,
    and a JPEG that lacks a part or of which no picture is made; then all up to the next keyframe. A
    decoder's frames are no longer marked as keyframes: behind a damaged one all are left out up to
    the time of the first keyframe that reaches the decoder afterwards.
    Decoders do not report what they fill in: jpegdec and avdec_h264 (1.22) mark and report nothing,
    and avdec_mjpeg, which logs it, ends the process for one wrong byte of a picture's header.
    """

    def __init__(self, pipeline: gst.Pipeline, sink: Any) -> None:
        """Of a pipeline that ends in `sink`, before it plays."""
        self.damaged = 0  # frames left out so far
        self.cause = ""  # of the newest of them
        self.lacks = ""  # what keeps it from finding damage: the end of a camera's sentence
        self._broken = False
        self._is_undecoded = False  # the newest JPEG, so far
        self._is_predicted = False  # what is decoded, from frames before it
        self._whole_from_ns: int | None = 0  # decoded frames; None: a keyframe must come first
        self._pipeline = pipeline
        Gst = gst.load().Gst
        pipeline.elements.connect("deep-element-added", self._on_added)
        elements = pipeline.elements.iterate_recurse()
        while (found := elements.next())[0] == Gst.IteratorResult.OK:
            self._watch(found[1])
        pad = sink.get_static_pad("sink")
        pipeline.add_probe(pad, Gst.PadProbeType.BUFFER, self._on_frame)

    def _on_added(self, _bin: Any, _sub_bin: Any, element: Any) -> None:
        self._watch(element)

    def _watch(self, element: Any) -> None:
        klass = element.get_metadata("klass")
        if "Decoder" in klass and ("Video" in klass or "Image" in klass):
            pad = element.get_static_pad("sink")
            self._pipeline.add_probe(pad, gst.load().Gst.PadProbeType.BUFFER, self._on_coded)

    def _on_coded(self, pad: Any, probe: Any) -> Any:
        Gst = gst.load().Gst
        flags, buffer = Gst.BufferFlags, probe.get_buffer()
        if buffer.pts == Gst.CLOCK_TIME_NONE:  # not one frame, perhaps; the capture refuses it
            return Gst.PadProbeReturn.OK
        is_jpeg = pad.get_current_caps().get_structure(0).get_name() == "image/jpeg"
        if self._is_undecoded:
            self._leave_out("JPEG pictures cannot be decoded")
        was_broken, self._broken, self._is_undecoded = self._broken, True, False
        if is_jpeg and turbojpeg() is None:
            self.lacks = LACKS
        if is_jpeg and (damage := damage_of(gst.pixels_of(buffer).tobytes())):
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


def damage_of(jpeg: bytes) -> str:
    """What is wrong with the picture, "" if nothing is found.

    Data lost within it are found by the order of restart markers and by libjpeg's first warning.
    Pictures that cannot be decoded at all are left to the decoder.
    """
    scan = jpeg.rfind(_SCAN)
    if (end := jpeg.find(_END, max(scan, 0))) < 0:
        return "JPEG pictures lack their end"
    restarts = b"".join(_RESTART.findall(jpeg, scan, end))
    in_order = (_RESTARTS * (len(restarts) // 8 + 1)).startswith(restarts)
    library = turbojpeg()
    if not in_order or (library and _DAMAGE.match(_warning(library, jpeg))):
        return "JPEG pictures lack a part"
    return ""


@cache
def turbojpeg() -> ctypes.CDLL | None:
    """The library that finds holes; None where it is not installed."""
    try:
        library = ctypes.CDLL("libturbojpeg.so.0")
    except OSError:
        return None
    library.tjInitDecompress.restype = ctypes.c_void_p
    library.tjGetErrorStr2.restype = ctypes.c_char_p
    return library


def _warning(library: ctypes.CDLL, jpeg: bytes) -> bytes:
    """libjpeg's first warning when it decodes the picture, b"" if it gives none."""
    # one for each picture: it keeps tables, and cameras leave out the standard ones
    decoder = ctypes.c_void_p(library.tjInitDecompress())
    try:
        picture = decoder, jpeg, ctypes.c_ulong(len(jpeg))
        sizes = [ctypes.c_int() for _ in range(4)]
        library.tjDecompressHeader3(*picture, *map(ctypes.byref, sizes))
        width, height = (-(-size.value // _SHRINK) for size in sizes[:2])
        how = ctypes.create_string_buffer(width * height), width, 0, height, _GREY, _STOP_ON_WARNING
        if not width * height or not library.tjDecompress2(*picture, *how):
            return b""
        is_warning = library.tjGetErrorCode(decoder) == _WARNING
        return bytes(library.tjGetErrorStr2(decoder)) if is_warning else b""
    finally:
        library.tjDestroy(decoder)
