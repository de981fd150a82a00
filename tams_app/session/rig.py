"""The simulated rig as the session sees it: processes to start, and devices like any other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hw.arm import Arm
from hw.arms import arm_kind
from hw.boundary import session_boundary
from hw.camera import Camera
from hw.controller import Controller
from hw.sim.operator.operator import Operator
from hw.sim.operator.operator_hand import operator_hand
from hw.sim.operator.perception import TruePerception
from hw.sim.operator.virtual_controller import VirtualController
from hw.sim.operator.wiring import rig_wiring
from hw.sim.world.camera import SimCamera
from hw.sim.world.shared_block import new_memory_name, remove_memory
from hw.sim.world.truth import TruthReader
from hw.sim.world.world_memory import WorldWriter
from tams_app.config import ArmConfig, Config
from tams_app.errors import ConfigError
from tams_app.records import SceneTruth
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.session.devices import Note
from tams_app.session.recorded_hand import recorded_hand

LOOPBACK = "127.0.0.1"


class SimulatedRig:
    """World and arm controller in one process, the cameras' renderer in another."""

    def __init__(
        self, config: Config, clock: Clock, log_directory: Path, operator_confirms: bool
    ) -> None:
        """`operator_confirms`: the scripted operator arms the arm by the menu button."""
        self._kind = arm_kind(config.arm.model)
        if not self._kind.rig:
            raise ConfigError(
                f"arm.model: there is no simulated rig with a {self._kind.title}; "
                "set rig.enabled to false"
            )
        self._operator_confirms = operator_confirms
        self._config = config
        self._clock = clock
        self._memory_name = new_memory_name()
        self._reader: TruthReader | None = None
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
        self.helpers = {
            "rig": HelperProcess("rig", self._kind.rig, world, log_directory),
            "renderer": HelperProcess("renderer", "hw.sim.world.renderer", renderer, log_directory),
        }

    def start(self) -> None:
        """Start the processes without waiting; see `wait_ready`."""
        WorldWriter(self._memory_name).close()  # there before any reader: no order of starting
        for helper in self.helpers.values():
            helper.start()

    def wait_ready(self) -> None:
        """Wait until arm and cameras can be reached; HelperError if one could not start."""
        ready = self.helpers["rig"].wait_ready()
        self._ports = (int(ready["control_port"]), int(ready["report_port"]))
        self._reader = TruthReader(self._memory_name)
        self.helpers["renderer"].wait_ready()

    def arm_config(self) -> ArmConfig:
        """The configured arm at the rig's address."""
        assert self._ports is not None, "wait until the rig is ready"
        control_port, report_port = self._ports
        return self._config.arm.model_copy(
            update={"host": LOOPBACK, "control_port": control_port, "report_port": report_port}
        )

    def make_arm(self) -> Arm:
        """The real driver; only the address is the rig's."""
        config = self._config
        boundary = session_boundary(config.arm, config.limits)
        return self._kind.make_arm(self.arm_config(), self._clock, config.control.rate_hz, boundary)

    def make_controller(self, note: Note) -> Controller:
        """The virtual controller in the scripted operator's hand, or a recorded hand's."""
        config = self._config
        if config.rig.hand_trajectory is not None:
            return recorded_hand(Path(config.rig.hand_trajectory))
        perception = TruePerception(self._read_truth)
        operator = Operator(
            operator_hand(config),
            config.rig.operator,
            perception,
            config.seed,
            self._operator_confirms,
        )
        return VirtualController(operator, config.rig.operator, config.seed, rig_wiring(config))

    def make_cameras(self, note: Note) -> list[Camera]:
        """One camera for each view."""
        return [
            SimCamera(view, self._memory_name, self._clock) for view in self._config.video.views
        ]

    @property
    def truth(self) -> Callable[[], SceneTruth | None]:
        """Tells where things really are; None before the world's first cycle."""
        return self._read_truth

    def _read_truth(self) -> SceneTruth | None:
        return self._reader.read() if self._reader else None

    def close(self) -> None:
        """End the processes and give the shared memory back, however they ended."""
        with ExitStack() as stack:  # one that fails keeps none of the others open
            stack.callback(remove_memory, self._memory_name)
            for helper in self.helpers.values():
                stack.callback(helper.stop)
            if self._reader is not None:
                stack.callback(self._reader.close)
