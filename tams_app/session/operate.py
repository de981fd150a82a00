"""`operate`: the operator's side alone; it samples the controller, shows the video, and asks.

The robot's side is called first: its configuration decides what is shown here. Then samples go
there from the moment on at which its video can be received: of a hand that is away, until the
controller has started, so that the robot's side knows how things stand here from the beginning.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tams_app.link.gateway_client import Endpoint
from tams_app.session.predicting import linked_present, predicted_cameras
from tams_app.session.session import Outset, Session
from tams_app.station.hand import MakeHand, OperatorHand, launch_operator
from tams_app.station.linked_robot import LinkedRobot, Requests, RobotFrames
from tams_app.station.operator_side import OperatorSide
from tams_app.station.receivers import Receivers
from tams_app.station.robot_call import call_robot
from tams_app.station.screen import Screen


@contextmanager
def operate(
    outset: Outset,
    endpoint: Endpoint,
    notify: Callable[[str], None],
    make_hand: MakeHand | None = None,
) -> Iterator[Session]:
    """A session of the operator's side; it commands nothing, all that stops the arm is there.

    `outset` has `Requests` as its signals. `notify` shows a sentence at once, while the start waits
    for the robot's side. `make_hand` makes what the operator holds; None: the configured device.
    """
    config, clock, requests = outset.config, outset.clock, outset.signals
    assert isinstance(requests, Requests), "the arm is elsewhere"
    with outset.starting() as parts:
        call = call_robot(config, clock, endpoint, parts, outset, notify, outset.folder.name)
        ours = call.config
        log = outset.open_log(ours, parts)
        call.record(log)
        is_rig, moves_by = call.welcome.simulated, call.moves_by
        cameras = {} if moves_by is None else predicted_cameras(moves_by)
        screen = Screen(ours.video, parts, log, cameras)
        present = linked_present(ours, moves_by, log, screen.mount)
        frames, feedback = RobotFrames(ours.video.views), call.welcome.feedback
        identify, displays = frames.identify(), outset.displays
        receivers = Receivers(ours.video, call.rule, feedback, clock, identify, screen, displays)
        parts.stack.callback(receivers.close)
        link = LinkedRobot(clock, call, requests, log, receivers, frames, present)
        receivers.start(link.connect(receivers.ports))

        def send(stop: threading.Event) -> None:
            parts.use_control_priority()
            link.run(stop)

        parts.run("hand", send)  # from now on the robot's side receives us
        simulated = None
        if make_hand is None:
            simulated = launch_operator(ours, clock, parts, log, screen)
        hand = OperatorHand(ours, clock, parts, log, is_rig, simulated, make_hand)
        screen.hide()
        link.controller = hand.take_controller()
        side = OperatorSide(ours, clock, receivers, link, call.welcome, log, outset)
        outset.ready(parts)
        with Session(outset, parts, log, side, screen, hand) as session:
            yield session
