"""The helper process of the simulated operator, who holds the rig's controller.

Specification: config, confirms, sees, controller_memory, shown_memory, world_memory, reports, and
that of `mount_specification`.
It publishes the controller at a rate of its own, as a VR runtime does, and reports what the seeing
operator's glances show. Here alone operator and world meet: the scripted operator reads where
things truly are, the seeing one gets the frames shown, nothing else.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, TypeAlias

import cv2

from hw.controller import Controller
from hw.remote_controller import ControllerPublisher
from hw.sim.operator.demo import demo_controller
from hw.sim.operator.seeing import Images, OnScreen, SeeingParticipant
from hw.sim.world.rig_memory import WorldReader
from tams_app.config import Config
from tams_app.prediction.present import Correction, Shown
from tams_app.records import Image
from tams_app.runtime.clock import Clock, FixedRate, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import (
    APPLICATION_PRIORITY,
    OPERATOR_PRIORITY,
    use_fifo,
    use_round_robin,
)
from tams_app.runtime.shared_ring import open_block
from tams_app.runtime.worker import Worker
from tams_app.station.mount_memory import described_views
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameReader, RingLayout
from tams_app.video.live.reporting_helper import line_of, reports_to_session

RATE_HZ = 125.0  # a sample for every tick of the control loop: each costs .1 to .3 ms
_SEND_TIMEOUT_S = 5.0
_POLL_S = 0.005
_LONGEST_S = 1.0 / 6.0  # from glance to glance
_SHARE_OF_MACHINE = 0.10  # of all cores, for the eyes
_SWITCH_S = 0.001  # how long the eyes may keep the hand waiting for the interpreter
Show: TypeAlias = Callable[[Image, int, int], Shown]  # an image, when it was captured, now [ns]


def on_screen(
    frames: Mapping[str, tuple[int, Image] | None], shows: Mapping[str, Show], now_ns: int
) -> OnScreen:
    """The screen before the operator at `now_ns`: frames as received, or predicted.

    Of an outline over a frame they make nothing: they look past it.

    Args:
        frames: the newest of each view, with when it was captured [ns]; None: nothing yet.
        shows: by view, how a frame is shown whose view is predicted.
        now_ns: on the clock of the screen.
    """
    images: dict[str, Image | None] = {}
    predicted = set()
    for view, found in frames.items():
        images[view] = None if found is None else found[1]
        if found is not None and view in shows:
            shown = shows[view](found[1], found[0], now_ns)
            if shown.correction is Correction.PREDICTED:
                images[view] = shown.image
                predicted.add(view)
    return OnScreen(images, frozenset(predicted))


def publish(publisher: ControllerPublisher, clock: Clock, stop: threading.Event) -> None:
    """Publish the controller at its rate until `stop` is set."""
    rate = FixedRate(clock, RATE_HZ)
    while not stop.is_set():
        publisher.step(clock.now_ns())
        rate.wait()


class Eyes:
    """The seeing operator's glances: as often as they look and as `share` of a core allows.

    But never fewer than the task needs: what costs less then is to show fewer frames.
    """

    def __init__(self, watch: Callable[[int], None], clock: Clock, share: float) -> None:
        """`watch`: looks if it is time to."""
        self._watch = watch
        self._clock = clock
        self._rest = 1.0 / share - 1.0  # per time spent looking

    def run(self, stop: threading.Event) -> None:
        """Look until `stop` is set; the body of a Worker."""
        use_round_robin(APPLICATION_PRIORITY)  # not below the hand's: they share the GIL
        while not stop.is_set():
            now_ns, began_ns = self._clock.now_ns(), time.thread_time_ns()
            self._watch(now_ns)
            spent_s = (time.thread_time_ns() - began_ns) / NS_PER_S
            took_s = (self._clock.now_ns() - now_ns) / NS_PER_S
            rest_s = min(self._rest * spent_s, _LONGEST_S - took_s)
            stop.wait(max(_POLL_S, rest_s))


def main() -> None:
    side = HelperSide()
    cv2.setNumThreads(1)
    with side.failing(), ExitStack() as stack:
        _serve(side, side.specification, stack)


def _serve(side: HelperSide, specification: dict[str, Any], stack: ExitStack) -> None:
    config, clock = Config.model_validate(specification["config"]), MonotonicClock()
    reports = stack.enter_context(reports_to_session(specification, _SEND_TIMEOUT_S))
    confirms, eyes = bool(specification["confirms"]), None
    if specification["sees"]:
        images = _screen(config, specification, stack)
        person = SeeingParticipant(config, config.seed, images, confirms)

        def watch(now_ns: int) -> None:
            glance = person.watch(now_ns)
            if glance is not None:
                reports.sendall(line_of(glance))

        controller: Controller = person.controller
        eyes = Worker(
            "eyes",
            Eyes(watch, clock, min(1.0, _SHARE_OF_MACHINE * len(os.sched_getaffinity(0)))).run,
            lambda *_: side.stop_requested.set(),
        )
        sys.setswitchinterval(_SWITCH_S)
    else:
        world = WorldReader(str(specification["world_memory"]))
        stack.callback(world.close)
        controller = demo_controller(config, world.truth, confirms=confirms)
    publisher = ControllerPublisher(str(specification["controller_memory"]), controller)
    stack.callback(publisher.close)
    use_fifo(OPERATOR_PRIORITY)
    if eyes is not None:
        stack.callback(eyes.stop)
        eyes.start()
    side.ready()
    publish(publisher, clock, side.stop_requested)
    if eyes is not None and eyes.failure is not None:
        raise eyes.failure


def _screen(config: Config, specification: dict[str, Any], stack: ExitStack) -> Images:
    """What is on the screen."""
    video = config.video
    layout = RingLayout(SHOWN, video.views, video.width, video.height)
    block = stack.enter_context(open_block(str(specification["shown_memory"])))
    readers = {view: FrameReader(block, layout, view) for view in video.views}
    shows = described_views(specification)

    def images(now_ns: int) -> OnScreen:
        frames = {view: reader.newest_frame() for view, reader in readers.items()}
        return on_screen(frames, shows, now_ns)

    return images


if __name__ == "__main__":
    main()
