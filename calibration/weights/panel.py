"""Raters who are not people: they exercise the way from ratings to W, and say nothing about views.

A simulated rater feels a necessity for each view (its mean in the phase, plus what he is generous
by, plus noise), rounds it to the scale, and names the view that he feels, noise drawn anew, to be
the most necessary. `paper` prefers the dominant view of the paper's Table I in each phase and is
indifferent between the others; `indifferent` prefers nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from calibration.weights.ratings import LEAST, MOST, Answer, Sheet
from tams_app.records import Phase

PAPER_DOMINANT = {
    Phase.REACH: "gt",
    Phase.ALIGN: "eih",
    Phase.GRASP: "eih",
    Phase.TRANSPORT: "gs",
    Phase.PRE_RELEASE: "eih",
    Phase.RELEASE: "eih",
}
PANELS: Mapping[str, Mapping[Phase, str]] = {"paper": PAPER_DOMINANT, "indifferent": {}}
PREFERRED, OTHER = 4.5, 3.0  # mean necessity
GENEROSITY = 0.4  # standard deviations, in points of the scale
NOISE = 0.7


def simulate_panel(
    preferred: Mapping[Phase, str],
    views: Sequence[str],
    phases: Iterable[Phase],
    raters: int,
    seed: int,
    noise: float = NOISE,
) -> list[Sheet]:
    """`raters` simulated sheets on `phases`; `preferred`: the favoured view of a phase, if any."""
    rated = tuple(phases)
    return [
        Sheet(
            f"simulated-{number:02d}",
            simulated=True,
            answers=_answers(preferred, views, rated, np.random.default_rng([seed, number]), noise),
        )
        for number in range(1, raters + 1)
    ]


def _answers(
    preferred: Mapping[Phase, str],
    views: Sequence[str],
    phases: Sequence[Phase],
    random: np.random.Generator,
    noise: float,
) -> tuple[Answer, ...]:
    generosity = random.normal(0.0, GENEROSITY)
    answers = []
    for phase in phases:
        means = np.array([PREFERRED if preferred.get(phase) == view else OTHER for view in views])
        felt = means + generosity + random.normal(0.0, noise, len(views))
        points = np.clip(np.rint(felt), LEAST, MOST).astype(int)
        needed_most = int(np.argmax(means + random.normal(0.0, noise, len(views))))
        necessity: dict[str, int | None] = {
            view: int(point) for view, point in zip(views, points, strict=True)
        }
        answers.append(Answer(phase, necessity, views[needed_most]))
    return tuple(answers)
