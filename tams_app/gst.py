"""GStreamer as TAMS uses it: loaded on first use, its elements checked, its bus polled."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.errors import SetupError

# The Debian package that brings each element.
_BASE = "gstreamer1.0-plugins-base"
_GOOD = "gstreamer1.0-plugins-good"
_BAD = "gstreamer1.0-plugins-bad"
_UGLY = "gstreamer1.0-plugins-ugly"
_LIBAV = "gstreamer1.0-libav"
_STREAMING = {
    "appsrc": _BASE,
    "appsink": _BASE,
    "videoconvert": _BASE,
    "x264enc": _UGLY,
    "h264parse": _BAD,
    "rtph264pay": _GOOD,
    "rtph264depay": _GOOD,
    "rtpsession": _GOOD,
    "rtprtxsend": _GOOD,
    "rtprtxreceive": _GOOD,
    "rtpssrcdemux": _GOOD,
    "rtpptdemux": _GOOD,
    "rtpjitterbuffer": _GOOD,
    "udpsrc": _GOOD,
    "udpsink": _GOOD,
    "avdec_h264": _LIBAV,
}
ELEMENT_PACKAGES = _STREAMING | {
    "v4l2src": _GOOD,
    "jpegdec": _GOOD,
    "videoscale": _BASE,
    "videoflip": _GOOD,
    "videotestsrc": _BASE,
    "audiotestsrc": _BASE,
    "audioconvert": _BASE,
    "audioresample": _BASE,
    "autoaudiosink": _GOOD,
    "decodebin": _BASE,
    "autovideosink": _GOOD,
    "ximagesink": "gstreamer1.0-x",
    "mp4mux": _GOOD,
    "qtdemux": _GOOD,
}
# By media type, the Debian package that demuxes or decodes it, where that is not libav's.
_FORMATS = (
    dict.fromkeys(("application/ogg", "video/x-theora"), _BASE)
    | dict.fromkeys(("video/quicktime", "video/webm", "video/x-matroska", "video/x-msvideo"), _GOOD)
    | dict.fromkeys(("image/jpeg", "video/x-flv", "video/x-vp8", "video/x-vp9"), _GOOD)
    | dict.fromkeys(("video/mpegts", "video/x-av1"), _BAD)
)
STREAMING_ELEMENTS = tuple(_STREAMING)


@dataclass(frozen=True, slots=True)
class GStreamer:
    """The modules of GObject introspection that TAMS uses (untyped at run time)."""

    Gst: Any
    GstVideo: Any
    GLib: Any
    Gio: Any


def _keep_exceptions_working() -> None:
    """Load GCC's unwinder before GStreamer brings libunwind's into the global scope.

    A C++ library loaded later (matplotlib's ft2font) would bind `_Unwind_Resume` to the latter and
    abort at its first exception.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # another C library: no such clash
            ctypes.CDLL("libgcc_s.so.1", mode=ctypes.RTLD_GLOBAL)


@cache
def load() -> GStreamer:
    """Import and initialise GStreamer once; SetupError with the command that installs it."""
    _keep_exceptions_working()
    try:
        import gi

        # GstApp only for its side effect: appsrc and appsink get their methods from it
        for module, version in (("Gst", "1.0"), ("GstApp", "1.0"), ("GstVideo", "1.0")):
            gi.require_version(module, version)
        from gi.repository import Gio, GLib, Gst, GstApp, GstVideo  # noqa: F401
    except (ImportError, ValueError) as error:
        raise SetupError(
            "GStreamer's Python bindings are missing; run `apt-get install gir1.2-gstreamer-1.0 "
            f"gir1.2-gst-plugins-base-1.0` and `pip install PyGObject` ({error})"
        ) from error
    Gst.init(None)
    return GStreamer(Gst, GstVideo, GLib, Gio)


def missing_elements(names: Iterable[str] = STREAMING_ELEMENTS) -> dict[str, str]:
    """The elements of `names` that cannot be made here, each with its Debian package."""
    find = load().Gst.ElementFactory.find
    return {
        name: ELEMENT_PACKAGES.get(name, "the plugin that provides it")
        for name in names
        if find(name) is None
    }


def require_elements(names: Iterable[str] = STREAMING_ELEMENTS) -> None:
    """SetupError in one sentence if any of `names` is missing."""
    if missing := missing_elements(names):
        packages = " ".join(sorted(set(missing.values())))
        raise SetupError(f"GStreamer lacks {', '.join(missing)}; install {packages}")


def parse_pipeline(description: str) -> Any:
    """A pipeline from its launch description; SetupError if it cannot be built."""
    modules = load()
    try:
        return modules.Gst.parse_launch(description)
    except modules.GLib.Error as error:
        raise SetupError(f"GStreamer cannot build a pipeline: {error.message}") from error


def count_from_boot(pipeline: Any) -> None:
    """Let the running time of `pipeline`, not yet playing, be that of CLOCK_MONOTONIC."""
    gst = load().Gst
    pipeline.use_clock(gst.SystemClock.obtain())
    pipeline.set_start_time(gst.CLOCK_TIME_NONE)
    pipeline.set_base_time(1)  # 0 stands for none


def set_playing(pipeline: Any, what: str) -> None:
    """Set a pipeline in motion; SetupError with the reason if it refuses."""
    gst = load().Gst
    if pipeline.set_state(gst.State.PLAYING) == gst.StateChangeReturn.FAILURE:
        reason = poll_bus(pipeline) or "no reason given"
        raise SetupError(f"{what} could not start: {reason}")


def poll_bus(pipeline: Any) -> str:
    """The first error on the pipeline's bus as a sentence, "" if there is none."""
    message = pipeline.get_bus().pop_filtered(load().Gst.MessageType.ERROR)
    if message is None:
        return ""
    error, _ = message.parse_error()
    return f"{message.src.get_name()}: {error.message}"


def missing_plugin(message: Any) -> str:
    """What to install for a stream, by an element message of the bus that misses it, else ""."""
    missing = message.get_structure()
    if missing.get_name() != "missing-plugin" or missing.get_string("type") != "decoder":
        return ""
    kind = missing.get_value("detail").get_structure(0).get_name()
    package = _FORMATS.get(kind, _LIBAV)
    return f"GStreamer cannot decode {kind} ({missing.get_string('name')}); install {package}"


def shut_down(pipeline: Any) -> None:
    """Take a pipeline to NULL and wait until its threads have ended; may be called twice."""
    gst = load().Gst
    pipeline.set_state(gst.State.NULL)
    pipeline.get_state(gst.CLOCK_TIME_NONE)
    pipeline.get_bus().set_flushing(True)


def raw_buffer(data: bytes | NDArray[np.uint8], pts_ns: int, duration_ns: int) -> Any:
    """A buffer that holds a copy of `data`, an array in one piece of any shape.

    Copied once and without the GIL, which GLib.Bytes does three times over and with it.
    """
    given = np.frombuffer(data, np.uint8)
    buffer = load().Gst.Buffer.new_allocate(None, given.size, None)
    _library().gst_buffer_fill(hash(buffer), 0, given.ctypes.data, given.size)
    buffer.pts = pts_ns
    buffer.duration = duration_ns
    return buffer


def pixels_of(buffer: Any) -> NDArray[np.uint8]:
    """A copy of what `buffer` holds."""
    size = buffer.get_size()
    pixels = np.empty(size, np.uint8)
    _library().gst_buffer_extract(hash(buffer), 0, pixels.ctypes.data, size)
    return pixels


@cache
def _library() -> ctypes.CDLL:
    """GStreamer itself, for what its Python binding does by way of lists or further copies.

    The hash of a structure that PyGObject wraps is its address.
    """
    library = ctypes.CDLL("libgstreamer-1.0.so.0")
    for function in (library.gst_buffer_fill, library.gst_buffer_extract):
        function.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t)
        function.restype = ctypes.c_size_t
    return library


class Pipeline:
    """A pipeline in whose threads code of ours runs.

    `failure`: why that code, or an element, has failed; "" while all work.
    """

    def __init__(self, description: str, what: str) -> None:
        """SetupError if it cannot be built. `what` it is, in sentences about it."""
        self.elements = parse_pipeline(description)
        self.what = what
        self.failure = ""

    def __getitem__(self, name: str) -> Any:
        """The element of this name; None if there is none."""
        return self.elements.get_by_name(name)

    def play(self) -> None:
        """Set it in motion; SetupError with the reason if it refuses."""
        set_playing(self.elements, self.what)

    def add_probe(self, pad: Any, kinds: Any, probe: Callable[[Any, Any], Any]) -> None:
        """Have `probe` see what passes `pad`; its error is a failure, and what it saw passes.

        One that raised would be taken to say that everything is dropped.
        """

        def guarded(pad: Any, info: Any) -> Any:
            try:
                return probe(pad, info)
            except Exception as error:  # noqa: BLE001 - the shell notifies the owner
                self.fail(error)
                return load().Gst.PadProbeReturn.OK

        pad.add_probe(kinds, guarded)

    def fail(self, error: Exception) -> None:
        """Our code has failed, in any thread; the first failure counts."""
        self.failure = self.failure or repr(error)

    def set_structure(self, element: str, name: str, text: str) -> None:
        """Set a property that is a structure, where there is such an element."""
        if (found := self[element]) is not None:
            structure, _ = load().Gst.Structure.from_string(text)
            found.set_property(name, structure)

    def poll(self) -> str:
        """Its failure in one sentence, for which the bus is looked at; "" while it works."""
        if not self.failure and (reason := poll_bus(self.elements)):
            self.failure = reason
        return f"{self.what} failed: {self.failure}" if self.failure else ""

    def close(self) -> None:
        """End it and its threads; may be called twice."""
        shut_down(self.elements)


def buffers_of(probe: Any) -> Iterator[Any]:
    """The buffers a pad probe carries, single or as a list (payloaders and udpsinks use lists)."""
    if probe.type & load().Gst.PadProbeType.BUFFER_LIST:
        buffers = probe.get_buffer_list()
        yield from (buffers.get(number) for number in range(buffers.length()))
    else:
        yield probe.get_buffer()


def pull_available(appsink: Any) -> Iterator[Any]:
    """The buffers that wait in `appsink`, without waiting for more; lists are taken apart."""
    while (sample := appsink.emit("try-pull-sample", 0)) is not None:
        several = sample.get_buffer_list()
        if several is None:
            yield sample.get_buffer()
        else:
            yield from (several.get(number) for number in range(several.length()))
