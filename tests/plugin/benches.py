"""Benches for the devices of `installed/`, as their author would write them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from hw.arm import Arm
from hw.arms import arm_kind, simulated_arm
from hw.boundary import session_boundary
from hw.camera import Camera
from hw.contract import ArmBench, CameraBench, ControllerBench
from hw.make_camera import make_camera
from hw.make_controller import make_controller
from tams_app.config import (
    ArmConfig,
    CameraConfig,
    ClutchConfig,
    ControllerConfig,
    HandConfig,
    LimitsConfig,
    VideoConfig,
)
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S


class OutsideArm(ArmBench):
    """In virtual time."""

    def __init__(self) -> None:
        self._config = ArmConfig(model="outside")
        self.limits = arm_kind("outside").limits
        self.ready_joints = np.radians(np.array(self._config.ready_joints_deg))
        self.deadman_s = self._config.velocity_deadman_s
        self._clock = VirtualClock()
        boundary = session_boundary(self._config, LimitsConfig())
        self._arm = simulated_arm(self._config, self._clock, self.ready_joints, boundary)

    def make_arm(self) -> Arm:
        return self._arm

    def advance(self, seconds: float) -> None:
        self._clock.advance_ns(round(seconds * NS_PER_S))
        self._arm.state()

    def elapsed_s(self) -> float:
        return self._clock.now_ns() / NS_PER_S


class OutsideCamera(CameraBench):
    """In real time."""

    view, video = "gs", VideoConfig()

    def camera(self) -> Camera:
        source = CameraConfig(source="outside")
        return make_camera(self.view, source, self.video, MonotonicClock(), lambda *_: None)


class OutsideController(ControllerBench):
    """In virtual time, with a foot on it."""

    def __init__(self) -> None:
        self._clock = VirtualClock()
        config = ControllerConfig(device="outside")
        self.controller = make_controller(
            config, HandConfig(), ClutchConfig(), self._clock, lambda *_: None
        )
        self.controller.pressed = True  # type: ignore[attr-defined]

    def advance(self) -> int:
        self._clock.advance_ns(8 * NS_PER_MS)
        return self._clock.now_ns()


@contextmanager
def arm() -> Iterator[ArmBench]:
    yield OutsideArm()


@contextmanager
def camera() -> Iterator[CameraBench]:
    yield OutsideCamera()


@contextmanager
def controller() -> Iterator[ControllerBench]:
    yield OutsideController()
