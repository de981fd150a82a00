"""Ticks of the control loop, sampled on an episode's grid: what a learner sees, and what was done.

Lengths in metres, angles in radians, as the names say; quaternions are x, y, z, w.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Phase, Tick
from tams_app.teleop.safety import ArmingState

STATE_NAMES = (
    *(f"joint_{number}_rad" for number in range(1, 7)),
    *("tcp_x_m", "tcp_y_m", "tcp_z_m", "tcp_qx", "tcp_qy", "tcp_qz", "tcp_qw", "gripper"),
)
ACTION_NAMES = (
    *("tcp_vx_m_s", "tcp_vy_m_s", "tcp_vz_m_s"),
    *("tcp_wx_rad_s", "tcp_wy_rad_s", "tcp_wz_rad_s", "gripper"),
)
PHASES = tuple(Phase)

_GRIPPER, _QUATERNION = -1, slice(-5, -1)  # in a state


class TickTable:
    """The ticks at which the arm had reported, as numbers: some 200 bytes each.

    times_ns: when each started, shape (n,). engaged_ns: of those in which the arm was engaged.
    """

    def __init__(self, ticks: Iterable[Tick]) -> None:
        times, values = array("q"), array("d")
        closed = False
        for tick in ticks:
            if tick.arm is None:
                continue
            if tick.arm.gripper_closed is not None:  # not known: as it was last
                closed = tick.arm.gripper_closed
            times.append(tick.started_ns)
            values.extend((*tick.arm.joints, *tick.arm.tcp.position, *tick.arm.tcp.rotation))
            values.extend((closed, *tick.twist.linear, *tick.twist.angular, closed))
            values.extend((PHASES.index(tick.phase), tick.arming == ArmingState.ENGAGED))
        width = len(STATE_NAMES) + len(ACTION_NAMES) + 2
        self.times_ns = np.frombuffer(times, np.int64)
        self._values = np.frombuffer(values, np.float64).reshape(-1, width)
        self.engaged_ns = self.times_ns[self._values[:, -1] == 1]

    def sample(self, grid_ns: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Features of a dataset, a row for each instant of `grid_ns`: the newest tick's values.

        None of the instants is before the first tick. The gripper of an action is what is commanded
        until the next instant.
        """
        rows = self._values[np.searchsorted(self.times_ns, grid_ns, side="right") - 1]
        state, action = rows[:, : len(STATE_NAMES)], rows[:, len(STATE_NAMES) : -2]
        action[:-1, _GRIPPER] = state[1:, _GRIPPER]
        # a quaternion and its negative are the same rotation: no jump from one to the other
        turned = state[:, _QUATERNION]
        signs = np.where(np.sum(turned[1:] * turned[:-1], axis=1) < 0, -1.0, 1.0)
        turned[1:] *= np.cumprod(signs)[:, np.newaxis]
        phase = rows[:, -2].astype(np.int64)
        return {
            "observation.state": state.astype(np.float32),
            "action": action.astype(np.float32),
            "phase": np.array([one.value for one in PHASES])[phase],
            "subtask_index": phase,
            "engaged": rows[:, -1].astype(np.bool_),
        }
