"""Pictures as they were shown: a few a second of each view, each readable by itself.

The bitstream can be decoded from a keyframe on, and the wire has one in 20 s. JPEG, as measured on
the rig's frames at 640×480: 0.8 ms and 34 kB for each picture, twice a second of three views .5 %
of a core and 200 kB/s. A second H.264 stream with a keyframe a second, x264 `ultrafast` at 10
frames a second: 1.5 ms each, 4.5 % of a core and 100 kB/s, and a pipeline for each view.
"""

from __future__ import annotations

import cv2
from foxglove import Context
from foxglove.channels import CompressedImageChannel
from foxglove.messages import CompressedImage

from tams_app.recording.topics import PICTURE_PREFIX
from tams_app.records import ShownFrame
from tams_app.telemetry.messages import timestamp
from tams_app.telemetry.pace import Pace

_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 70)


class Pictures:
    """Chooses frames for `/shown/<view>` and sends them."""

    def __init__(
        self, context: Context, views: tuple[str, ...], offset_ns: int, rate_hz: float
    ) -> None:
        """`offset_ns`: from the session's clock to that of the wall; no rate: no pictures."""
        shown = views if rate_hz else ()
        self._paces = {view: Pace(rate_hz) for view in shown}
        self._channels = {
            view: CompressedImageChannel(PICTURE_PREFIX + view, context=context) for view in shown
        }
        self._offset_ns = offset_ns

    def wants(self, view: str, shown_ns: int) -> bool:
        """True if a frame shown now is to be sent; each view from one thread."""
        pace = self._paces.get(view)
        return pace is not None and pace.is_due(shown_ns)

    def on_picture(self, shown: ShownFrame) -> None:
        """Send a frame that was wanted; OpenCV encodes it without the GIL."""
        _, data = cv2.imencode(".jpg", shown.image, _QUALITY)
        wall_ns = shown.shown_ns + self._offset_ns
        message = CompressedImage(
            timestamp=timestamp(wall_ns), frame_id=shown.view, data=data.tobytes(), format="jpeg"
        )
        self._channels[shown.view].log(message, log_time=wall_ns)
