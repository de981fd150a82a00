"""The operator's side at this computer: what they hold, the receivers, the screen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from msgspec.structs import replace

from hw.controller import Controller
from hw.desk.keyboard import KeyboardController
from hw.make_controller import make_controller
from tams_app.config import Config
from tams_app.prediction.present import PredictedCamera
from tams_app.recording.journal import Journal
from tams_app.records import ShownFrame, SteeredBy, ViewState
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.station.camera_watch import CameraWatch
from tams_app.station.fresh_video import Displays
from tams_app.station.mount_memory import MountMemory
from tams_app.station.receivers import Receivers
from tams_app.station.recorded_hand import recorded_hand
from tams_app.station.rig_operator import RigOperator
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import Decoder
from tams_app.video.core.frame_identity import SentFrame
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.stages import together
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tams_app.video.live.installed_codecs import installed_codecs

MakeHand = Callable[[Config], Controller]
_SIMULATED = {
    "seeing": "seeing (uses only the received images)",
    "scripted": "scripted (gets positions from the simulator)",
}


class Station:
    """`launch` and `receive` in either order, then `wait_ready`, `take_controller`; each once.

    `screen`: the memory of the frames shown, for windows, for a simulated operator who looks at
    them, and for those who score them. `mount`: where the camera on the arm is, by which
    its frames are corrected; None: none are. `keyboard`: the controller, where a window has to feed
    it.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        parts: Parts,
        log: Journal,
        displays: Displays,
        is_rig: bool,
        make: MakeHand | None = None,
        cameras: Mapping[str, PredictedCamera] | None = None,
    ) -> None:
        """`displays`: what shows the frames to a person. `is_rig`: the robot is simulated.

        `make` makes what the operator holds; None: the configured device, or the simulated one.
        `cameras`: by view, those whose frames are corrected; None: none are.
        """
        self._config, self._clock, self._parts, self._log = config, clock, parts, log
        self._displays, self._is_rig, self._make = displays, is_rig, make
        video = config.video
        self.screen = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        parts.stack.callback(self.screen.close)
        self.mount = MountMemory(cameras) if cameras else None
        self._camera_watch: CameraWatch | None = None
        if self.mount is not None:
            parts.stack.callback(self.mount.close)
            self._camera_watch = CameraWatch(self.mount, log.note)
        self.keyboard: KeyboardController | None = None
        self._simulated: RigOperator | None = None
        self._receivers: Receivers | None = None

    # --- start ----------------------------------------------------------------------------------

    def launch(self, confirms: bool = True, world_memory: str = "") -> None:
        """Start a simulated operator, if there is one, without waiting.

        `confirms`: they arm the arm themselves. `world_memory`: of the rig, for one who knows
        where things are; "": they must see.
        """
        config, parts = self._config, self._parts
        is_there = self._make is not None or config.rig.hand_trajectory is not None
        if is_there or not config.operator_is_simulated:
            return
        self._simulated = operator = RigOperator(
            config,
            self._clock,
            parts,
            world_memory,
            self.screen,
            self.mount,
            confirms=confirms,
            on_glance=self._log.record,
        )
        parts.stack.callback(operator.close)
        parts.watch("operator", operator.launch())

    def receive(
        self,
        rule: RepairRule,
        feedback: bool,
        identify: Mapping[str, Callable[[int], SentFrame | None]],
        decoder: Decoder | None = None,
    ) -> Receivers:
        """Bind the receivers, which the caller closes; the arguments are those of `Receivers`.

        `decoder`: None: the configured one.
        """
        self._receivers = receivers = Receivers(
            self._config.video,
            rule,
            feedback,
            self._clock,
            identify,
            self._on_shown,
            decoder or installed_codecs(self._config.video).decoder,
            self._displays,
        )
        return receivers

    def wait_ready(self) -> None:
        """Wait for a simulated operator; HelperError if they cannot begin."""
        if self._simulated is not None:
            self._simulated.wait_ready()
            kind = self._simulated.kind
            self._introduce(kind, f"simulated operator: {_SIMULATED[kind]}")
        elif self._make is None and self._config.operator_is_simulated:
            self._introduce("recorded", "the operator is a recorded hand, which sees nothing")
        else:
            device, what = self._config.controller.device, "rig" if self._is_rig else "arm"
            self._introduce("person", f"a person drives the {what}: {device}")
        self.screen.hide()  # all other processes that read it have it open
        if self.mount is not None:
            self.mount.hide()

    def take_controller(self) -> Controller:
        """The operator's controller, started; DeviceError if it is not there."""
        make = self._make or self._configured
        controller = make(self._config)
        if isinstance(controller, KeyboardController):  # the console's window feeds it
            self.keyboard = controller
        self._parts.stack.callback(controller.close)
        controller.start()
        self._parts.hurry(controller.realtime_thread_ids)
        return controller

    def _configured(self, config: Config) -> Controller:
        trajectory = config.rig.hand_trajectory
        if self._simulated is not None:
            return self._simulated.controller
        if config.operator_is_simulated and trajectory is not None:
            return recorded_hand(Path(trajectory))
        note = self._log.note
        return make_controller(config.controller, config.hand, self._clock, note)

    def _introduce(self, operator: str, sentence: str) -> None:
        self._log.fact("operator", operator)
        self._log.note("info", sentence)

    # --- while it runs --------------------------------------------------------------------------

    def steered_by(self, view: str) -> SteeredBy:
        """The frame of this view that the operator can steer by now."""
        return SteeredBy() if self._receivers is None else self._receivers.steered_by(view)

    def views(
        self, robots: Mapping[str, ViewState], now_ns: int, offset_ns: int | None
    ) -> dict[str, ViewState]:
        """All views, as the robot's side knows them and as they are shown here.

        `offset_ns`: the robot's clock minus ours; None: not known.
        """
        return {
            view: self._view(view, robots.get(view, ViewState()), now_ns, offset_ns)
            for view in self._config.video.views
        }

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return "" if self._receivers is None else self._receivers.poll()

    def _view(self, view: str, robots: ViewState, now_ns: int, offset_ns: int | None) -> ViewState:
        receivers = self._receivers
        if receivers is None:
            return robots
        shown = receivers.shown(view)
        latency_ms = age_ms = None
        if offset_ns is not None:
            steered_ns = receivers.steered_by(view).capture_ns
            if steered_ns is not None:
                age_ms = (now_ns + offset_ns - steered_ns) / NS_PER_MS
            if shown is not None:
                latency_ms = (shown.shown_ns + offset_ns - shown.capture_ns) / NS_PER_MS
        fps = receivers.shown_fps(view)
        own = together(robots.own, receivers.latency(view))
        return replace(robots, shown_fps=fps, latency_ms=latency_ms, age_ms=age_ms, own=own)

    def _on_shown(self, shown: ShownFrame) -> None:
        """In a thread for each view."""
        self._log.record(shown)
        self.screen.put(shown.view, shown.index, shown.shown_ns, shown.image, shown.capture_ns)
        if self._camera_watch is not None:
            self._camera_watch.shown(shown)
