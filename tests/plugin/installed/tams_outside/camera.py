"""A camera of one grey."""

from hw.gstreamer.capture import GstCapture
from tams_app.config import CameraConfig, VideoConfig


class Grey:
    noisy = False
    endless = True

    def __init__(self, view: str, config: CameraConfig, video: VideoConfig) -> None:
        self.label = f"grey of {view}"
        self._video = video

    def open(self) -> GstCapture:
        video = self._video
        return GstCapture(
            "videotestsrc is-live=true pattern=solid-color foreground-color=0xff808080 "
            f"! video/x-raw,format=I420,width={video.width},height={video.height},"
            f"framerate={video.fps}/1",
            video,
        )

    def complaints(self) -> list[str]:
        return []
