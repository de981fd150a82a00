"""What the operator holds: the configured device, a recorded hand, or a simulated operator's."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hw.controller import Controller
from hw.desk.keyboard import KeyboardController
from hw.make_controller import make_controller
from hw.remote_controller import RemoteController
from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import OperatorGlance
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name
from tams_app.station.recorded_hand import recorded_hand
from tams_app.station.screen import Screen, mount_specification
from tams_app.video.live.reporting_helper import ReportingHelper

MakeHand = Callable[[Config], Controller]
_SIMULATED = {
    "seeing": "seeing (uses only the received images)",
    "scripted": "scripted (gets positions from the simulator)",
}


class RigOperator:
    """The process of an operator who holds the rig's controller, `controller`.

    To the session its end is what the end of a VR runtime is, and the end of the session besides.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        parts: Parts,
        log: Journal,
        screen: Screen,
        confirms: bool = True,
        world_memory: str = "",
    ) -> None:
        """`log` gets what they see on the `screen`, in a thread of its own.

        `confirms`: the operator arms the arm by the menu button. `world_memory`: of the rig, for
        one who knows where things are; "": it is not here, so that they must see.
        """
        self.kind = config.rig.operator.kind if world_memory else "seeing"
        sees = self.kind == "seeing"
        mount = screen.mount if config.rig.operator.looks_at == "shown" else None
        self._frames = screen.frames if sees else None
        memory_name = new_block_name()  # of the controller
        self._specification = {
            "config": config.model_dump(mode="json"),
            "confirms": confirms,
            "sees": sees,
            "controller_memory": memory_name,
            "shown_memory": screen.frames.name,
            "world_memory": world_memory,
            **mount_specification(mount),
        }
        self._helper = ReportingHelper(
            "operator",
            "tams_app.station.operator_process",
            log_directory=parts.logs,
            report_type=OperatorGlance,
            on_report=log.record,
            on_failure=parts.on_failure,
            ended_unasked="the simulated operator's process ended unasked; start a new session",
        )
        self.controller = RemoteController(memory_name, clock, self._runs)

    def launch(self) -> HelperProcess:
        """Start the process without waiting."""
        if self._frames is not None:
            self._frames.create()
        return self._helper.launch(self._specification)

    def wait_ready(self) -> None:
        """Wait until the controller is published; HelperError if it cannot be."""
        self._helper.wait_ready()
        self.controller.hide()

    def close(self) -> None:
        """End the process and give its memory back; may be called twice."""
        with ExitStack() as stack:
            stack.callback(self.controller.let_go)
            stack.callback(self._helper.close)

    def _runs(self) -> bool:
        process = self._helper.process
        return process is not None and process.exit_code is None


def launch_operator(
    config: Config,
    clock: Clock,
    parts: Parts,
    log: Journal,
    screen: Screen,
    confirms: bool = True,
    world_memory: str = "",
) -> RigOperator | None:
    """Begin to start a simulated operator; None: there is none. The arguments are theirs."""
    if not config.operator_is_simulated or config.rig.hand_trajectory is not None:
        return None
    operator = RigOperator(config, clock, parts, log, screen, confirms, world_memory)
    parts.stack.callback(operator.close)
    parts.watch("operator", operator.launch())
    return operator


class OperatorHand:
    """What they hold; `take_controller` once.

    `keyboard`: the controller once it is taken, where a window has to feed it; None: another one.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        parts: Parts,
        log: Journal,
        is_rig: bool,
        simulated: RigOperator | None = None,
        make: MakeHand | None = None,
    ) -> None:
        """Wait for a simulated operator; HelperError if they cannot begin.

        `is_rig`: the robot is simulated. `make` makes what the operator holds; None: the configured
        device, or the simulated one.
        """
        self._config, self._clock, self._parts, self._log = config, clock, parts, log
        self._simulated, self._make = simulated, make or self._configured
        self.keyboard: KeyboardController | None = None
        if simulated is not None:
            simulated.wait_ready()
            kind = simulated.kind
            self._introduce(kind, f"simulated operator: {_SIMULATED[kind]}")
        elif make is None and config.operator_is_simulated:
            self._introduce("recorded", "the operator is a recorded hand, which sees nothing")
        else:
            device, what = config.controller.device, "rig" if is_rig else "arm"
            self._introduce("person", f"a person drives the {what}: {device}")

    def take_controller(self) -> Controller:
        """The operator's controller, started; DeviceError if it is not there."""
        controller = self._make(self._config)
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
        return make_controller(config.controller, config.hand, self._clock, self._log.note)

    def _introduce(self, operator: str, sentence: str) -> None:
        self._log.fact("operator", operator)
        self._log.note("info", sentence)
