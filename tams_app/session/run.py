"""`run`: both sides in one process, joined without a link."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec.structs import replace

from tams_app.records import SessionState
from tams_app.robot.listener import Listener
from tams_app.robot.side import RobotSide, bind_video, start_devices
from tams_app.robot.status import StatusBoard
from tams_app.session.local_operator import LocalOperator
from tams_app.session.quality import LiveQuality, task_regions
from tams_app.session.session import Outset, Session
from tams_app.station.hand import OperatorHand, launch_operator
from tams_app.station.receivers import Receivers
from tams_app.station.screen import Screen

if TYPE_CHECKING:  # few sessions predict
    from tams_app.prediction.present import PredictedCamera


@contextmanager
def run(outset: Outset, arm_at_once: bool = False, dry_run: bool = False) -> Iterator[Session]:
    """A session of both sides; `arm_at_once` and `dry_run`: see `LiveGround`.

    `outset` has `Signals` as its signals.
    """
    config, clock = outset.config, outset.clock
    with outset.starting() as parts:
        log = outset.open_log(config, parts)
        predicts = config.view.predict != "off"
        cameras: Mapping[str, PredictedCamera] = {}
        if predicts:
            from tams_app.session.predicting import follow_states, predicted_cameras

            cameras = predicted_cameras(config)
        screen = Screen(config.video, parts, log, cameras)
        ground = outset.ground(parts, log, arm_at_once, dry_run)
        board, devices = StatusBoard(config, log.newest), start_devices(ground)
        confirms, world = not arm_at_once, devices.memory_name
        simulated = launch_operator(config, clock, parts, log, screen, confirms, world)
        regions = task_regions(config)  # of the frames that are scored
        quality = LiveQuality(config.video, parts, screen, log, regions)
        quality.start()  # before `bind_video`, at which a capacity trace begins
        video = bind_video(ground, board, quality.captured)
        identify = {view: frames.find for view, frames in video.sent.items()}
        rule, feedback = video.rule, video.feedback
        receivers = Receivers(
            config.video, rule, feedback, clock, identify, screen, outset.displays
        )
        parts.stack.callback(receivers.close)
        entrances = video.enter_network(receivers.ports)
        receivers.start(entrances)
        video.start(entrances)
        outset.go_on()
        devices.wait_ready()
        hand = OperatorHand(config, clock, parts, log, config.rig.enabled, simulated)
        screen.hide()
        outset.go_on()
        operator = LocalOperator(hand, receivers, config)
        listeners: tuple[Listener, ...] = (regions,)
        if predicts:
            listeners = (*follow_states(config, clock, parts, log, screen.mount), regions)
        robot = RobotSide(ground, board, devices, video, operator, listeners)
        outset.ready(parts)
        robot.begin()
        side = BothSides(robot, receivers, quality)
        with Session(outset, parts, log, side, screen, hand) as session:
            yield session


@dataclass(frozen=True, slots=True)
class BothSides:
    """The two sides, and what compares the frames of the one with those of the other."""

    robot: RobotSide
    receivers: Receivers
    quality: LiveQuality

    def poll(self) -> str:
        return self.robot.poll() or self.receivers.poll()

    def state(self) -> SessionState:
        state = self.robot.state()
        views = self.receivers.views(state.views, state.now_ns, offset_ns=0)
        return replace(state, views=self.quality.views(views, state.now_ns))

    def stop_arm(self, failed: bool) -> None:
        self.robot.stop_arm(failed)

    def finish(self, reason: str, failed: bool) -> None:
        self.robot.finish(reason, failed)
