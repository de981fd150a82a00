"""The simulated rig as the session sees it: processes to start, and devices like any other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hw.arms import arm_kind
from hw.controller import Controller
from hw.sim.world.camera import SimCamera
from hw.sim.world.rig_memory import WorldReader, WorldWriter, remove_memory
from tams_app.config import ArmConfig, Config
from tams_app.errors import ConfigError
from tams_app.records import SceneTruth
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name
from tams_app.session.devices import Devices, Note
from tams_app.session.recorded_hand import recorded_hand
from tams_app.session.recorders import SessionRecords
from tams_app.session.rig_operator import RigOperator
from tams_app.video.live.frame_ring import FrameBlock

LOOPBACK = "127.0.0.1"


class SimulatedRig(Devices):
    """World and arm controller in one process, the cameras' renderer and the operator in others."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        log_directory: Path,
        log: SessionRecords,
        screen: FrameBlock,
        on_failure: Callable[[str, BaseException], None],
        operator_confirms: bool,
        operator_is_here: bool = True,
    ) -> None:
        """`screen`: where the frames shown are put, for an operator who looks at them.

        `operator_confirms`: the simulated operator arms the arm by the menu button.
        `operator_is_here`: else there is neither an operator nor a controller. Whether they are
        simulated is `Config.operator_is_simulated`.
        """
        super().__init__(config, clock)
        kind = arm_kind(config.arm.model)
        if not kind.rig:
            raise ConfigError(
                f"arm.model: there is no simulated rig with a {kind.title}; "
                "set rig.enabled to false"
            )
        self._log = log
        self._memory_name = new_block_name()
        self._reader: WorldReader | None = None
        self._ports: tuple[int, int] | None = None
        world = {
            "memory_name": self._memory_name,
            "seed": config.seed,
            "host": LOOPBACK,
            "control_port": 0,
            "report_port": 0,
            "start_joints_deg": config.arm.ready_joints_deg,
        }
        renderer = {
            "memory_name": self._memory_name,
            "seed": config.seed,
            "fps": config.video.fps,
            "nice": config.rig.render_nice,
            "noise_sigma": config.rig.camera_noise_sigma,
        }
        self.helpers: dict[str, HelperProcess] = {
            "rig": HelperProcess("rig", kind.rig, world, log_directory),
            "renderer": HelperProcess("renderer", "hw.sim.world.renderer", renderer, log_directory),
        }
        self._operator: RigOperator | None = None
        self._operator_is_here = operator_is_here
        if operator_is_here and config.operator_is_simulated and not config.rig.hand_trajectory:
            self._operator = RigOperator(
                config,
                clock,
                self._memory_name,
                screen,
                log_directory,
                confirms=operator_confirms,
                on_glance=log.record,
                on_failure=on_failure,
            )

    def start(self) -> None:
        WorldWriter(self._memory_name).close()  # there before any reader: no order of starting
        for helper in self.helpers.values():
            helper.start()
        if self._operator is not None:
            self.helpers["operator"] = self._operator.launch()

    def wait_ready(self) -> None:
        ready = self.helpers["rig"].wait_ready()
        self._ports = (int(ready["control_port"]), int(ready["report_port"]))
        self._reader = WorldReader(self._memory_name)
        self.helpers["renderer"].wait_ready()
        if self._operator is not None:
            self._operator.wait_ready()
            self._tell(self._operator.choice.kind, self._operator.choice.sentence)
        elif not self._operator_is_here:
            self._tell("elsewhere", "the operator is at another computer")
        elif not self._config.operator_is_simulated:
            device = self._config.controller.device
            self._tell("person", f"a person drives the rig: {device}")
        else:
            self._tell("recorded", "the operator is a recorded hand, which sees nothing")

    def _tell(self, operator: str, sentence: str) -> None:
        self._log.fact("operator", operator)
        self._log.note("info", sentence)

    def arm_config(self) -> ArmConfig:
        assert self._ports is not None, "wait until the rig is ready"
        control_port, report_port = self._ports
        return self._config.arm.model_copy(
            update={"host": LOOPBACK, "control_port": control_port, "report_port": report_port}
        )

    def make_controller(self, note: Note) -> Controller:
        """The controller in the hand of the simulated operator, a recorded one, or a person."""
        trajectory = self._config.rig.hand_trajectory
        if not self._config.operator_is_simulated:
            return super().make_controller(note)
        if self._operator is None:
            assert trajectory is not None, "then there is an operator"
            return recorded_hand(Path(trajectory))
        return self._operator.controller

    def make_cameras(self, note: Note) -> list[SimCamera]:
        return [
            SimCamera(view, self._memory_name, self._clock) for view in self._config.video.views
        ]

    def ask_fps(self, fps: float) -> None:
        self.helpers["renderer"].tell(fps=fps)

    @property
    def truth(self) -> Callable[[], SceneTruth | None]:
        return self._read_truth

    def _read_truth(self) -> SceneTruth | None:
        return self._reader.truth() if self._reader else None

    def close(self) -> None:
        """End the processes and give the shared memory back, however they ended."""
        with ExitStack() as stack:  # one that fails keeps none of the others open
            stack.callback(remove_memory, self._memory_name)
            for helper in self.helpers.values():
                stack.callback(helper.stop)
            if self._operator is not None:
                stack.callback(self._operator.close)
            if self._reader is not None:
                stack.callback(self._reader.close)
