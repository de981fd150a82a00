"""What the operator holds: the configured device, a recorded hand, or a simulated operator's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from hw.controller import Controller
from hw.make_controller import make_controller
from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.station.screen import Screen

if TYPE_CHECKING:  # a person holds a tracked controller
    from hw.desk.keyboard import KeyboardController
    from tams_app.station.rig_operator import RigOperator

MakeHand = Callable[[Config], Controller]
_SIMULATED = {
    "seeing": "seeing (uses only the received images)",
    "scripted": "scripted (gets positions from the simulator)",
}


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
    from tams_app.station.rig_operator import RigOperator

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
        if self._config.controller.device == "keyboard":
            from hw.desk.keyboard import KeyboardController

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
            from tams_app.station.recorded_hand import recorded_hand

            return recorded_hand(Path(trajectory))
        return make_controller(config.controller, config.hand, self._clock, self._log.note)

    def _introduce(self, operator: str, sentence: str) -> None:
        self._log.fact("operator", operator)
        self._log.note("info", sentence)
