"""The real devices as the session sees them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hw.arm import Arm
from hw.arms import arm_kind
from hw.boundary import session_boundary
from hw.camera import Camera
from hw.controller import Controller
from hw.make_camera import make_camera
from hw.openvr.controller import OpenVrController
from tams_app.config import ArmConfig, Config
from tams_app.records import SceneTruth
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.session.devices import Note


class HardwareDevices:
    """The configured arm, an OpenVR controller and one camera for each view."""

    def __init__(self, config: Config, clock: Clock) -> None:
        self._config = config
        self._clock = clock

    @property
    def helpers(self) -> Mapping[str, HelperProcess]:
        return {}

    @property
    def truth(self) -> Callable[[], SceneTruth | None] | None:
        return None  # the operator says how the task went

    def start(self) -> None:
        """Nothing of ours has to run before the devices are opened."""

    def wait_ready(self) -> None:
        """Whether a device is there shows when it is opened."""

    def arm_config(self) -> ArmConfig:
        return self._config.arm

    def make_arm(self) -> Arm:
        config = self._config
        boundary = session_boundary(config.arm, config.limits)
        kind = arm_kind(config.arm.model)
        return kind.make_arm(config.arm, self._clock, config.control.rate_hz, boundary)

    def make_controller(self, note: Note) -> Controller:
        return OpenVrController(self._config.controller, self._clock, note)

    def make_cameras(self, note: Note) -> list[Camera]:
        config = self._config
        return [
            make_camera(view, config.cameras[view], config.video, self._clock, note)
            for view in config.video.views
        ]

    def close(self) -> None:
        """The devices are closed by the session, which opened them."""
