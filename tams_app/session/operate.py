"""`operate`: the operator's side alone; it samples the controller, shows the video, and asks."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from tams_app.config import Config
from tams_app.link.gateway_client import Endpoint
from tams_app.records import SessionState
from tams_app.runtime.clock import Clock
from tams_app.session.predicting import linked_present, predicted_cameras
from tams_app.session.session import Session
from tams_app.station.linked_robot import LinkedRobot
from tams_app.station.requests import Requests
from tams_app.station.robot_call import call_robot
from tams_app.station.robot_watch import RobotWatch
from tams_app.station.station import MakeHand, Station
from tams_app.units import NS_PER_MS

_STOP_SENT_NS = 100 * NS_PER_MS


def operate(
    config: Config,
    clock: Clock,
    folder: Path,
    endpoint: Endpoint,
    notify: Callable[[str], None],
    make_hand: MakeHand | None = None,
) -> Session:
    """A session of the operator's side; it commands nothing, all that stops the arm is there.

    `notify` shows a sentence at once, while the start waits for the robot's side. `make_hand` makes
    what the operator holds; None: the configured device.
    """
    requests = Requests()

    def compose(session: Session) -> OperatorSide:
        parts = session.parts
        call = call_robot(config, clock, endpoint, parts, session, notify, folder.name)
        ours, views = call.config, call.config.video.views
        log = session.open_log(ours)
        call.record(log)
        is_rig = call.welcome.simulated
        moves_by, displays = call.moves_by, session.displays
        cameras = {} if moves_by is None else predicted_cameras(moves_by)
        station = Station(ours, clock, parts, log, displays, is_rig, make_hand, cameras)
        link = LinkedRobot(
            clock,
            call.gateway,
            requests,
            log,
            lambda: tuple(map(station.steered_by, views)),
            call.identity,
            call.hand,
            linked_present(ours, moves_by, log, station.mount),
        )
        identify, feedback = link.identify(views), call.welcome.feedback
        receivers = station.receive(call.rule, feedback, identify)
        parts.stack.callback(receivers.close)
        receivers.start(link.connect(ours.video, receivers.ports))

        def send(stop: threading.Event) -> None:
            parts.use_control_priority()
            link.run(stop)

        parts.run("hand", send)  # from now on the robot's side receives us
        station.launch()
        station.wait_ready()
        link.controller = station.take_controller()
        watch = RobotWatch(ours, clock, link, call.welcome, log.note, session.end)
        side = OperatorSide(session, station, link, watch)
        session.ready(side)
        return side

    return Session(config, clock, folder, requests, compose)


@dataclass(frozen=True, slots=True)
class OperatorSide:
    """The parts at the operator's computer; they command nothing."""

    session: Session
    station: Station
    link: LinkedRobot
    watch: RobotWatch

    @property
    def pids(self) -> dict[str, int]:
        return {}

    def poll(self) -> str:
        return self.station.poll() or self.watch.poll()

    def state(self) -> SessionState:
        state, offset = self.watch.state(self.session.elapsed_s()), self.link.offset
        offset_ns = None if offset is None else offset.offset_ns
        return replace(state, views=self.station.views(state.views, state.now_ns, offset_ns))

    def stop_arm(self, failed: bool) -> None:
        """Let go: the robot's side receives that the operator leaves, and stops."""
        if self.link.controller is not None:
            self.link.controller = None
            clock = self.session.clock
            clock.sleep_until_ns(clock.now_ns() + _STOP_SENT_NS)

    def finish(self, reason: str, failed: bool) -> None:
        """Record what is known here of the task; the gateway notifies the robot's side."""
        self.session.log.record(self.watch.outcome(reason))
