"""A hand with a controller in it, and what a tracking runtime may make of its readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw.controller import Controller
from tams_app.config import Config
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose, Vector
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S

_TREMOR_M = 2e-5
_HAND_AT = (0.0, 1.0, -0.3)

# From the true reading and the last one delivered to the one the runtime delivers.
Distortion = Callable[[ControllerSample, ControllerSample], ControllerSample]


class Hand(Controller):
    """A living hand; `velocity` is what it asks of the arm [m/s], base frame."""

    def __init__(self, config: Config) -> None:
        self.velocity: Vector = np.zeros(3)
        self.trigger = 0.0
        self.a = self.b = self.menu = False
        self.distortion: Distortion | None = None
        self.pulses: list[Haptic] = []
        self.travelled_m = 0.0  # the hand's own way, whatever is delivered
        self._from_base = np.array(config.hand.rotation).T
        self._random = np.random.default_rng(7)
        self._position = np.array(_HAND_AT)
        self._last_ns: int | None = None
        self._delivered: ControllerSample | None = None

    def start(self) -> None:
        """Nothing to connect to."""

    def sample(self, now_ns: int) -> ControllerSample:
        elapsed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) / NS_PER_S
        self._last_ns = now_ns
        step = self._from_base @ self.velocity * elapsed_s
        self._position = self._position + step
        self.travelled_m += float(np.linalg.norm(step))
        tremor = self._random.uniform(-_TREMOR_M, _TREMOR_M, 3)
        sample = ControllerSample(
            ControllerStatus.OK,
            Pose(self._position + tremor, Rotation.identity()),
            now_ns,
            now_ns,
            self.trigger,
            0.0,
            self.a,
            self.b,
            self.menu,
        )
        if self.distortion is not None and self._delivered is not None:
            sample = self.distortion(sample, self._delivered)
        self._delivered = sample
        return sample

    def pulse(self, haptic: Haptic) -> None:
        self.pulses.append(haptic)

    def close(self) -> None:
        """Nothing to let go of."""
