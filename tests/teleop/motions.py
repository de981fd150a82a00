"""Any profiles a configuration may hold, and any state of motion the shaping may be in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from tams_app.config.motion import MAX_STOP_TIME_S, longest_stop_s
from tams_app.teleop.trajectory import Profile

unit = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array)


def within(size: float) -> st.SearchStrategy[np.ndarray]:
    """Vectors of shape (3,) of at most this norm."""
    return unit.map(lambda v: size * v / max(1.0, float(np.linalg.norm(v))))


@dataclass(frozen=True)
class Case:
    """A state of motion within `top` and `motion`, to be stopped with `stop`."""

    top: float
    motion: Profile
    stop: Profile
    velocity: np.ndarray
    acceleration: np.ndarray

    @property
    def is_reachable(self) -> bool:
        """Whether the acceleration can die out without exceeding the speed (shaping.py)."""
        size = float(np.linalg.norm(self.acceleration))
        coasted = self.velocity + self.acceleration * size / (2 * self.motion.jerk)
        return bool(np.linalg.norm(coasted) <= self.top)


@st.composite
def profiles(draw: st.DrawFn) -> tuple[float, Profile, Profile]:
    """A speed, a motion and a stop profile that the configuration accepts."""
    stop = Profile(draw(st.floats(2, 50)), draw(st.floats(50, 2000)))
    motion = Profile(
        stop.acceleration * draw(st.floats(0.05, 1)), stop.jerk * draw(st.floats(0.05, 1))
    )
    top = 0.5
    while longest_stop_s(top, motion.acceleration, stop.acceleration, stop.jerk) > MAX_STOP_TIME_S:
        top *= 0.8
        motion = Profile(motion.acceleration * 0.8, motion.jerk)
    return top, motion, stop


@st.composite
def motions_of(draw: st.DrawFn, top: float, motion: Profile, stop: Profile) -> Case:
    acceleration = draw(within(motion.acceleration))
    speed = draw(within(top))
    size = float(np.linalg.norm(acceleration))
    # As fast as the acceleration still allows along this direction, or slower.
    for share in (1.0, 0.9, 0.7, 0.5, 0.2, 0.0):
        case = Case(top, motion, stop, speed * share, acceleration)
        if case.is_reachable:
            return case
    fastest = min(size, (2 * motion.jerk * top) ** 0.5)
    smaller = acceleration * (fastest / size)
    return Case(top, motion, stop, np.zeros(3), smaller * (1 - 1e-12))


@st.composite
def plans(draw: st.DrawFn) -> Case:
    """A reachable state of any accepted profiles."""
    return draw(motions_of(*draw(profiles())))
