"""The simulated operator, who holds the rig's controller: a process of its own."""

from __future__ import annotations

from contextlib import ExitStack

from hw.remote_controller import RemoteController
from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import OperatorGlance
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name
from tams_app.station.screen import Screen, mount_specification
from tams_app.video.live.reporting_helper import ReportingHelper


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
