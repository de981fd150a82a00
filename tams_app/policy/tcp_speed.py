"""Smoothed speed of the measured TCP, the input of phase inference."""

from __future__ import annotations

import math

import numpy as np

from tams_app.records import Vector
from tams_app.runtime.clock import NS_PER_S

_MIN_INTERVAL_S = 0.002  # two reports closer than this came out of one socket read


class SmoothedSpeed:
    """v̄ = EMA(‖v‖) and v̄_z = EMA(v_z), with α = 1 - exp(-Δt/τ); the first sample initialises.

    v is the difference of successive TCP positions over their receive times; rotation does not
    count. A repeated report changes nothing.
    """

    def __init__(self, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._position: Vector | None = None
        self._received_ns = 0
        self._started = False
        self.speed = 0.0
        self.vertical_speed = 0.0

    def update(self, position: Vector, received_ns: int) -> None:
        """Take in the TCP `position` [m], shape (3,), of the report received at `received_ns`."""
        if self._position is None:
            self._position, self._received_ns = position, received_ns
            return
        interval_s = (received_ns - self._received_ns) / NS_PER_S
        if interval_s < _MIN_INTERVAL_S:
            return
        velocity = (position - self._position) / interval_s
        self._position, self._received_ns = position, received_ns
        self._smooth(float(np.linalg.norm(velocity)), float(velocity[2]), interval_s)

    def _smooth(self, speed: float, vertical_speed: float, interval_s: float) -> None:
        if not self._started:
            self.speed, self.vertical_speed, self._started = speed, vertical_speed, True
            return
        alpha = 1.0 - math.exp(-interval_s / self._time_constant_s)
        self.speed += alpha * (speed - self.speed)
        self.vertical_speed += alpha * (vertical_speed - self.vertical_speed)
