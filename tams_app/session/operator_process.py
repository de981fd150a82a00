"""The helper process of the simulated operator, who holds the rig's controller.

Specification: config, confirms, controller_memory, world_memory, reports_port. It publishes the
controller 250 times a second, as a VR runtime does. Here alone operator and world meet: the
scripted operator reads where things truly are.
"""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack
from typing import Any

from hw.controller import Controller
from hw.sim.operator.demo import demo_controller
from hw.sim.operator.remote_controller import ControllerPublisher
from hw.sim.world.rig_memory import WorldReader
from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.runtime.clock import Clock, FixedRate, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import OPERATOR_PRIORITY, use_fifo

RATE_HZ = 250.0
_CONNECT_TIMEOUT_S = 5.0


def publish(publisher: ControllerPublisher, clock: Clock, stop: threading.Event) -> None:
    """Publish the controller at its rate until `stop` is set."""
    rate = FixedRate(clock, RATE_HZ)
    while not stop.is_set():
        publisher.step(clock.now_ns())
        rate.wait()


def main() -> None:
    side = HelperSide()
    try:
        _serve(side, side.specification)
    except TamsError as error:
        side.fail(str(error))
        raise SystemExit(error.exit_code) from error


def _serve(side: HelperSide, specification: dict[str, Any]) -> None:
    config = Config.model_validate(specification["config"])
    address = ("127.0.0.1", int(specification["reports_port"]))
    with ExitStack() as stack:
        stack.enter_context(socket.create_connection(address, _CONNECT_TIMEOUT_S))
        controller = _scripted(config, specification, stack)
        publisher = ControllerPublisher(str(specification["controller_memory"]), controller)
        stack.callback(publisher.close)
        use_fifo(OPERATOR_PRIORITY)
        side.ready()
        publish(publisher, MonotonicClock(), side.stop_requested)


def _scripted(config: Config, specification: dict[str, Any], stack: ExitStack) -> Controller:
    world = WorldReader(str(specification["world_memory"]))
    stack.callback(world.close)
    return demo_controller(config, world.truth, confirms=bool(specification["confirms"]))


if __name__ == "__main__":
    main()
