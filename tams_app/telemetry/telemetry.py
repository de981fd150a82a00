"""All channels for viewers of one session, fed with what its log keeps."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from foxglove import Context, Schema

from tams_app.recording import Header
from tams_app.recording.codec import Codec
from tams_app.recording.topics import OutcomeGiven
from tams_app.records import MountPrediction, Note, SceneTruth, ShownFrame, StopRecord, Tick
from tams_app.telemetry.address import Address
from tams_app.telemetry.lines import LogLines
from tams_app.telemetry.live import LiveServer
from tams_app.telemetry.motion import MotionChannels
from tams_app.telemetry.pace import Pace
from tams_app.telemetry.pictures import Pictures
from tams_app.telemetry.rates import Rates
from tams_app.telemetry.scene import Scene, SceneChannels

SCENE_HZ = 0.2
RATES = "/rates"


class Telemetry:
    """Feeds every channel; satisfies `tams_app.recording.Viewers`. From one thread at a time."""

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
        schema = Schema(name=Rates.__name__, encoding="jsonschema", data=self._codec.schema())
        # not foxglove.Channel: that one keeps every channel of the process in a global table
        self._rates = context._create_channel(RATES, message_encoding="json", schema=schema)
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

    def receive(self, record: Any, now_ns: int) -> None:
        """A record that the log keeps, the rates of a second, or a frame shown that was wanted."""
        if on_record := self._on.get(type(record)):
            on_record(record)

    def wants(self, view: str, shown_ns: int) -> bool:
        """True if a frame shown now is wanted with its pixels; each view in one thread."""
        return self._pictures.wants(view, shown_ns)

    def close(self) -> None:
        """Let the viewers go; may be called twice."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _on_tick(self, tick: Tick) -> None:
        if self._scene_pace.is_due(tick.started_ns):
            self._scene.send(tick.started_ns + self._offset_ns)
        self._motion.on_tick(tick)

    def _on_rates(self, rates: Rates) -> None:
        self._rates.log(self._codec.encode(rates), rates.t_ns + self._offset_ns)
