"""How right the frame's calibration is: `python -m benchmarks.frame_fit`. No wall clock in it.

Strokes and touches of known truth under random rotations, and the wizard with its simulated person.
"""

from __future__ import annotations

import argparse
import io
import math
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import transform

from calibration.frame.asking import fit_moves
from calibration.frame.fit import Matrix, fit_strokes, turn_deg
from calibration.frame.result import rows
from calibration.frame.sources import SimulatedSetup
from calibration.frame.stroke import RefusedError, Stroke
from calibration.frame.touches import Touch, fit_touches
from calibration.ui import WizardUI
from tams_app.config import load_config
from tams_app.rotation import Rotation

Errors = tuple[float, float]  # of the rotation, and what the fit says it may be [deg]
_ONE_AXIS = 1 / math.sqrt(3)  # a sample that is 5 mm off in space is 2.9 mm off along each axis


def strokes(truth: Matrix, random: np.random.Generator, rounds: int, samples: int, length_m: float,
            noise_m: float) -> Errors:  # fmt: skip
    along = np.linspace(0.0, length_m, samples)
    made = [
        Stroke(axis, np.outer(along, truth[axis]) + random.normal(0.0, noise_m, (samples, 3)))
        for _ in range(rounds)
        for axis in range(3)
    ]
    fit = fit_strokes(made)
    return turn_deg(fit.rotation, truth), fit.error_bound_deg


def touches(truth: Matrix, random: np.random.Generator, count: int, noise_m: float) -> Errors:
    """Corners of a box of 200 mm by 200 mm by 140 mm, below and above in turn, then its middles."""
    corners = [[1, 1, 0.7], [-1, 1, -0.7], [-1, -1, 0.7], [1, -1, -0.7], [0, 0, 1], [0, 0, -1]]
    robot = 0.1 * np.array(corners)[:count]
    hand = robot @ truth + random.normal(0.0, noise_m, robot.shape)
    fit = fit_touches([Touch(r, h, Rotation.identity()) for r, h in zip(robot, hand, strict=True)])
    return turn_deg(fit.rotation, truth), fit.error_bound_deg


def simulated_person(truth: Matrix, seed: int) -> Errors:
    turned = [list(row) for row in rows(truth)]
    config = load_config(None, {"rig.hand_rotation": turned})
    with SimulatedSetup(config, seed).hand(config.controller) as source:
        fit = fit_moves(WizardUI(Console(file=io.StringIO())), source, config, rounds=2)
    return turn_deg(fit.rotation, truth), fit.error_bound_deg


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frame_fit", description=__doc__)
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--wizard-seeds", type=int, default=100)
    options = parser.parse_args()
    table = Table(box=None)
    for name in ("what", "mean", "p95", "max", "under 1°", "bound (median)", "held", "refused"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for name, noise_m in (("in space", 0.005 * _ONE_AXIS), ("along each axis", 0.005)):
        for rounds, samples, length_m in ((1, 50, 0.2), (2, 50, 0.2), (2, 120, 0.3)):
            _add(
                table,
                f"{rounds} × 3 strokes, {1000 * length_m:.0f} mm, {samples} samples, 5 mm {name}",
                options.seeds,
                lambda truth, seed, *how: strokes(truth, np.random.default_rng(seed), *how),
                (rounds, samples, length_m, noise_m),
            )
    for count in (4, 6):
        for noise_m in (0.002, 0.005):
            _add(
                table,
                f"{count} touches, {1000 * noise_m:.0f} mm along each axis",
                options.seeds,
                lambda truth, seed, *how: touches(truth, np.random.default_rng(seed), *how),
                (count, noise_m),
            )
    _add(table, "wizard, simulated person", options.wizard_seeds, simulated_person, ())
    Console(width=120).print(table)


def _add(
    table: Table,
    name: str,
    seeds: int,
    trial: Callable[..., Errors],
    how: tuple[float, ...],
) -> None:
    found: list[Errors] = []
    for seed in range(seeds):
        truth = transform.Rotation.random(random_state=seed).as_matrix()
        try:
            found.append(trial(truth, seed, *how))
        except RefusedError:
            continue
    errors, bounds = np.array(found).T
    table.add_row(
        name,
        f"{errors.mean():.2f}°",
        f"{np.percentile(errors, 95):.2f}°",
        f"{errors.max():.2f}°",
        f"{(errors < 1).mean():.1%}",
        f"{np.median(bounds):.2f}°",
        f"{(errors <= bounds).mean():.1%}",
        str(seeds - len(found)),
    )


if __name__ == "__main__":
    main()
