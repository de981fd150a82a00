"""The simulated rig as the session sees it: processes to start, and devices like any other."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from hw.arms import arm_kind
from hw.sim.world.rig_memory import SimCamera, WorldReader, WorldWriter, remove_memory
from tams_app.config import ArmConfig, Config
from tams_app.errors import ConfigError
from tams_app.records import SceneTruth, TakeNote
from tams_app.robot.devices import Devices, Truth
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name

LOOPBACK = "127.0.0.1"


class SimulatedRig(Devices):
    """World and arm controller in one process, the cameras' renderer in another."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        log_directory: Path,
    ) -> None:
        super().__init__(config, clock)
        kind = arm_kind(config.arm.model)
        if not kind.rig:
            raise ConfigError(
                f"arm.model: there is no simulated rig with a {kind.title}; "
                "set rig.enabled to false"
            )
        self.memory_name = new_block_name()
        self._reader: WorldReader | None = None
        self._ports: tuple[int, int] | None = None
        self._put_back = 0
        world = {
            "memory_name": self.memory_name,
            "seed": config.seed,
            "start_joints_deg": config.arm.ready_joints_deg,
        }
        renderer = {
            "memory_name": self.memory_name,
            "seed": config.seed,
            "fps": config.video.fps,
        }
        self.helpers: dict[str, HelperProcess] = {
            "rig": HelperProcess("rig", kind.rig, world, log_directory),
            "renderer": HelperProcess("renderer", "hw.sim.world.renderer", renderer, log_directory),
        }

    def start(self) -> None:
        WorldWriter(self.memory_name).close()  # there before any reader: no order of starting
        for helper in self.helpers.values():
            helper.start()

    def wait_ready(self) -> None:
        ready = self.helpers["rig"].wait_ready()
        self._ports = (int(ready["control_port"]), int(ready["report_port"]))
        self._reader = WorldReader(self.memory_name)
        self.helpers["renderer"].wait_ready()

    def arm_config(self) -> ArmConfig:
        assert self._ports is not None, "wait until the rig is ready"
        control_port, report_port = self._ports
        return self._config.arm.model_copy(
            update={"host": LOOPBACK, "control_port": control_port, "report_port": report_port}
        )

    def make_cameras(self, note: TakeNote) -> list[SimCamera]:
        return [SimCamera(view, self.memory_name, self._clock) for view in self._config.video.views]

    def put_back(self) -> None:
        self._put_back += 1
        self.helpers["rig"].send(put_back=self._put_back)

    @property
    def truth(self) -> Truth:
        return self._truth

    def _truth(self) -> SceneTruth | None:
        return self._reader.truth() if self._reader else None

    def close(self) -> None:
        """End the processes and give the shared memory back, however they ended."""
        with ExitStack() as stack:  # one that fails keeps none of the others open
            stack.callback(remove_memory, self.memory_name)
            for helper in self.helpers.values():
                stack.callback(helper.stop)
            if self._reader is not None:
                stack.callback(self._reader.close)
