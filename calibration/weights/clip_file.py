"""Clips as files: written as MP4 with H.264, which any player opens, and played in a window."""

from __future__ import annotations

import os
from pathlib import Path

from tams_app import gst
from tams_app.console.windows import require_display
from tams_app.errors import SetupError
from tams_app.records import Image
from tams_app.units import NS_PER_MS, NS_PER_S

_QUANTISER = 18  # of x264: hardly to be told from the original
_WRITING = ("appsrc", "videoconvert", "x264enc", "h264parse", "mp4mux", "filesink")
_PLAYING = ("filesrc", "qtdemux", "h264parse", "avdec_h264", "videoconvert", "autovideosink")
_FLUSH_NS = 60 * NS_PER_S
_POLL_NS = 50 * NS_PER_MS


class ClipWriter:
    """Writes one clip; the file is there, whole, after `finish` and not before."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        """`width` and `height` of every image [pixels]."""
        gst.require_elements(_WRITING)
        self._path, self._fps = path, fps
        self._partial = path.with_suffix(".part")
        self._count = 0
        self._pipeline = gst.parse_pipeline(
            "appsrc name=images format=time block=true max-buffers=4 max-bytes=0 "
            f'caps="video/x-raw,format=BGR,width={width},height={height},framerate={fps}/1" '
            "! videoconvert ! video/x-raw,format=I420 "
            f"! x264enc pass=quant quantizer={_QUANTISER} speed-preset=superfast key-int-max={fps} "
            "! video/x-h264,profile=high ! h264parse ! mp4mux faststart=true "
            "! filesink name=file async=false"
        )
        self._pipeline.get_by_name("file").set_property("location", str(self._partial))
        self._images = self._pipeline.get_by_name("images")
        try:
            gst.set_playing(self._pipeline, f"writing {path.name}")
        except SetupError:
            self.close()
            raise

    def add(self, image: Image) -> None:
        """The next image, BGR; SetupError if it cannot be written."""
        pts_ns = self._count * NS_PER_S // self._fps
        buffer = gst.raw_buffer(image.tobytes(), pts_ns, NS_PER_S // self._fps)
        self._count += 1
        self._images.emit("push-buffer", buffer)
        if reason := gst.poll_bus(self._pipeline):
            raise SetupError(f"{self._path}: cannot be written: {reason}")

    def finish(self) -> None:
        """Complete the file and give it its name; SetupError if it cannot be written."""
        kinds = gst.load().Gst.MessageType
        self._images.emit("end-of-stream")
        message = self._pipeline.get_bus().timed_pop_filtered(_FLUSH_NS, kinds.EOS | kinds.ERROR)
        ended = message is not None and message.type == kinds.EOS
        gst.shut_down(self._pipeline)
        if not ended:
            self.close()
            raise SetupError(f"{self._path}: cannot be written: is the disk full?")
        os.replace(self._partial, self._path)

    def close(self) -> None:
        """Give up what is not finished; may be called always."""
        gst.shut_down(self._pipeline)
        self._partial.unlink(missing_ok=True)


def play(path: Path) -> None:
    """Show a clip once in a window, which may be closed before its end.

    SetupError if there is no display or the file cannot be played.
    """
    require_display()
    gst.require_elements(_PLAYING)
    Gst = gst.load().Gst
    pipeline = gst.parse_pipeline(
        "filesrc name=file ! qtdemux ! h264parse ! avdec_h264 ! videoconvert ! autovideosink"
    )
    pipeline.get_by_name("file").set_property("location", str(path))
    wanted = Gst.MessageType.EOS | Gst.MessageType.ERROR
    try:
        gst.set_playing(pipeline, f"showing {path.name}")
        # in short waits, so that Ctrl-C is heard between them
        while (message := pipeline.get_bus().timed_pop_filtered(_POLL_NS, wanted)) is None:
            pass
        if message.type == Gst.MessageType.ERROR:
            error, _ = message.parse_error()
            # what every sink says of a window that was closed; a file that is gone is told before
            if not error.matches(Gst.ResourceError.quark(), Gst.ResourceError.NOT_FOUND):
                raise SetupError(
                    f"{path}: cannot be shown: {error.message}; if the file is broken, delete it "
                    "and name its session with --from again"
                )
    finally:
        gst.shut_down(pipeline)
