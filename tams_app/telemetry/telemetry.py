"""All channels for viewers of one session, fed with what its log keeps."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import cv2
from foxglove import Context
from foxglove.channels import CompressedImageChannel
from foxglove.messages import CompressedImage

from tams_app.recording import Header, Viewer
from tams_app.recording.codec import Codec
from tams_app.recording.mcap_log import json_channel, timestamp
from tams_app.recording.rates import Rates
from tams_app.recording.topics import PICTURE_PREFIX, OutcomeGiven
from tams_app.records import MountPrediction, Note, SceneTruth, ShownFrame, StopRecord, Tick
from tams_app.telemetry.address import Address
from tams_app.telemetry.gate import LiveServer
from tams_app.telemetry.lines import LogLines
from tams_app.telemetry.motion import MotionChannels, Pace
from tams_app.telemetry.scene import Scene, SceneChannels

SCENE_HZ = 0.2
RATES = "/rates"
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 70)


class Pictures:
    """Chooses frames for `/shown/<view>` and sends them: a few a second, each readable by itself.

    The bitstream can be decoded from a keyframe on, and the wire has one in 20 s. JPEG, as measured
    on the rig's frames at 640×480: 0.8 ms and 34 kB for each picture, twice a second of three views
    .5 % of a core and 200 kB/s. A second H.264 stream with a keyframe a second, x264 `ultrafast` at
    10 frames a second: 1.5 ms each, 4.5 % of a core and 100 kB/s, and a pipeline for each view.
    """

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


class Telemetry(Viewer):
    """Feeds every channel."""

    def __init__(
        self,
        context: Context,
        header: Header,
        scene: Scene,
        pictures_per_s: float,
        address: Address | None = None,
        origins: Collection[str] = (),
    ) -> None:
        """Channels of `context`, served at `address` to programs and to pages of `origins`.

        SetupError if they cannot be.
        """
        offset_ns = header.wall_offset_ns
        self._offset_ns = offset_ns
        lines = LogLines(context, offset_ns)
        self._motion = MotionChannels(context, scene, offset_ns)
        self._pictures = Pictures(context, header.views, offset_ns, pictures_per_s)
        self._scene = SceneChannels(context, scene)
        self._scene_pace = Pace(SCENE_HZ)
        self._codec = Codec(Rates)
        self._rates = json_channel(context, RATES, self._codec)
        self._on: dict[type, Callable[[Any], None]] = {
            Tick: self._on_tick,
            SceneTruth: self._motion.on_truth,
            MountPrediction: self._motion.on_prediction,
            Note: lines.send,
            StopRecord: lines.send,
            OutcomeGiven: lines.send,
            Rates: self._on_rates,
            ShownFrame: self._pictures.on_picture,
        }
        self._server = (
            None if address is None else LiveServer(context, address, header.name, origins)
        )

    def receive(self, record: Any) -> None:
        if on_record := self._on.get(type(record)):
            on_record(record)

    def wants(self, view: str, shown_ns: int) -> bool:
        return self._pictures.wants(view, shown_ns)

    def close(self) -> None:
        """Let the viewers go; may be called twice."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()

    def _on_tick(self, tick: Tick) -> None:
        if self._scene_pace.is_due(tick.started_ns):
            self._scene.send(tick.started_ns + self._offset_ns)
        self._motion.on_tick(tick)

    def _on_rates(self, rates: Rates) -> None:
        self._rates.log(self._codec.encode(rates), rates.t_ns + self._offset_ns)
