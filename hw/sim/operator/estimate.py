"""A Gaussian estimate and what a measurement makes of it: the arithmetic of a Kalman filter."""

from __future__ import annotations

import numpy as np

from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Vector


class GaussianEstimate:
    """A state, shape (n,), and its covariance, shape (n, n), in whatever units the caller has.

    The numbers that are not sought stay what they are, but how uncertain they are counts (Schmidt
    1966): for errors too fickle to be learnt, yet too lasting to be averaged out.
    """

    def __init__(self, state: Vector, sigma: Vector, sought: int) -> None:
        """`sought`: so many of the numbers are estimated, the others only reckoned with."""
        self._sought = sought
        self.state = np.array(state, float)
        self.covariance: Matrix = np.diag(np.asarray(sigma, float) ** 2)

    def fade(self, kept: Vector) -> None:
        """Numbers of mean 0 and variance 1 keep only a part, 0..1, of what they were."""
        self.state = kept * self.state
        self.covariance = self.covariance * kept[:, None] * kept
        self.covariance[np.diag_indices(len(kept))] += 1.0 - kept**2

    def forget(self, place: slice, sigma: float) -> None:
        """Nothing is known of the numbers at `place` but their standard deviation."""
        self.covariance[place, :] = self.covariance[:, place] = 0.0
        self.covariance[place, place] = np.eye(place.stop - place.start) * sigma**2

    def surprise(self, rows: Matrix, gaps: Vector, noise: Matrix) -> float:
        """Squared distance of a measurement from what was expected, in standard deviations."""
        spread = rows @ self.covariance @ rows.T + noise
        return float(gaps @ np.linalg.solve(spread, gaps))

    def update(self, rows: Matrix, gaps: Vector, noise: Matrix) -> None:
        """Take in a measurement, shape (m,), that is off by `gaps` from what was expected.

        `rows`, shape (m, n): its Jacobian; `noise`, shape (m, m): its covariance.
        """
        weighted = rows @ self.covariance
        spread = weighted @ rows.T + noise
        gain = np.linalg.solve(spread, weighted).T
        gain[self._sought :] = 0.0
        self.state = self.state + gain @ gaps
        known = gain @ weighted
        covariance = self.covariance - known - known.T + gain @ spread @ gain.T
        self.covariance = (covariance + covariance.T) / 2
