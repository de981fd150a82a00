"""The simulated operator as the session sees them: a helper process, and its controller."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from hw.remote_controller import RemoteController
from tams_app.config import Config
from tams_app.records import OperatorGlance
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name
from tams_app.station.mount_memory import MountMemory, mount_specification
from tams_app.video.live.frame_ring import FrameBlock
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
        world_memory: str,
        screen: FrameBlock,
        mount: MountMemory | None,
        *,
        confirms: bool,
        on_glance: Callable[[OperatorGlance], None],
    ) -> None:
        """`parts`: where its process writes, and who is notified of its failure.

        `world_memory`: of the rig; "": it is not here, so that they must see. `screen`: where the
        frames shown are put, for an operator who looks at them; `mount`: that of the cameras whose
        frames are corrected. `confirms`: the operator arms the arm by the menu button. `on_glance`
        is called in a thread of its own.
        """
        self.kind = config.rig.operator.kind if world_memory else "seeing"
        sees = self.kind == "seeing"
        self._screen = screen if sees else None
        memory_name = new_block_name()  # of the controller
        self._specification = {
            "config": config.model_dump(mode="json"),
            "confirms": confirms,
            "sees": sees,
            "controller_memory": memory_name,
            "shown_memory": screen.name,
            "world_memory": world_memory,
            **mount_specification(mount if config.rig.operator.looks_at == "shown" else None),
        }
        self._helper = ReportingHelper(
            "operator",
            "tams_app.station.operator_process",
            log_directory=parts.logs,
            report_type=OperatorGlance,
            on_report=on_glance,
            on_failure=parts.on_failure,
            ended_unasked="the simulated operator's process ended unasked; start a new session",
        )
        self.controller = RemoteController(memory_name, clock, self._runs)

    def launch(self) -> HelperProcess:
        """Start the process without waiting."""
        if self._screen is not None:
            self._screen.create()
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
