"""Strokes of known truth."""

import numpy as np

from calibration.frame.fit import Stroke
from tams_app.rotation import Rotation


def stroke(
    rotation,
    axis,
    random,
    length_m=0.2,
    samples=50,
    noise_m=0.0,
    wrong_deg=0.0,
    bow=0.0,
    sign=1,
):
    """Along the robot's `axis` in a tracking frame that `rotation` takes to the arm's base."""
    wrong = np.radians(wrong_deg) * random.standard_normal(3)
    along = Rotation.from_rotvec(wrong).apply(sign * rotation.T[:, axis])
    aside = np.cross(along, [0.3, -0.5, 0.81])
    aside /= np.linalg.norm(aside)
    way = np.linspace(0.0, 1.0, samples)[:, None]
    points = length_m * (way * along + bow * 4 * way * (1 - way) * aside)
    start = random.uniform(-0.3, 0.3, 3)
    return Stroke(axis, start + points + noise_m * random.standard_normal((samples, 3)))


def strokes(rotation, random, rounds=1, **how):
    return [stroke(rotation, axis, random, **how) for _ in range(rounds) for axis in range(3)]
