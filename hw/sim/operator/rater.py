"""Raters of views who are not people: what one answers on each phase.

They exercise the way from ratings to W, and say nothing about views. A simulated rater feels a
necessity for each view (its mean in the phase, plus the rater's generosity, plus noise), rounds it
to the scale, and names the view that feels, noise drawn anew, the most necessary. `paper` prefers
the dominant view of the paper's Table I in each phase and is indifferent between the others;
`indifferent` prefers nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

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


def rate(
    preferred: Mapping[Phase, str],
    views: Sequence[str],
    phases: Sequence[Phase],
    scale: tuple[int, int],
    random: np.random.Generator,
    noise: float = NOISE,
) -> Iterator[tuple[Phase, dict[str, int | None], str]]:
    """One rater's answers: each phase, the points of each view, and the view needed most.

    `preferred`: the favoured view of a phase, if any. `scale`: the fewest and the most points.
    """
    generosity = random.normal(0.0, GENEROSITY)
    for phase in phases:
        means = np.array([PREFERRED if preferred.get(phase) == view else OTHER for view in views])
        felt = means + generosity + random.normal(0.0, noise, len(views))
        points = np.clip(np.rint(felt), *scale).astype(int)
        needed_most = int(np.argmax(means + random.normal(0.0, noise, len(views))))
        necessity: dict[str, int | None] = dict(zip(views, points.tolist(), strict=True))
        yield phase, necessity, views[needed_most]
