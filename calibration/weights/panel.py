"""`calibrate weights --sim`: a session on the simulated rig, and raters who are not people.

They exercise the way from ratings to W, and say nothing about views. A simulated rater feels a
necessity for each view (its mean in the phase, plus the rater's generosity, plus noise), rounds it
to the scale, and names the view that feels, noise drawn anew, the most necessary. The panel prefers
the dominant view of the paper's Table I in each phase and is indifferent between the others.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path

import numpy as np

from calibration.weights.ratings import LEAST, MOST, RatedPhase, RatingFolder, Sheet
from tams_app.config import load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Phase

PAPER_DOMINANT = {
    Phase.REACH: "gt",
    Phase.ALIGN: "eih",
    Phase.GRASP: "eih",
    Phase.TRANSPORT: "gs",
    Phase.PRE_RELEASE: "eih",
    Phase.RELEASE: "eih",
}
_PREFERRED, _OTHER = 4.5, 3.0  # mean necessity
RATERS = 8  # as many as the paper asked
_GENEROSITY, _NOISE = 0.4, 0.7  # standard deviations, in points of the scale


def simulate_panel(views: Sequence[str], seed: int, raters: int = RATERS) -> list[Sheet]:
    """Simulated sheets on every phase, whichever have clips."""
    return [_sheet(views, number, seed) for number in range(1, raters + 1)]


def _sheet(views: Sequence[str], number: int, seed: int) -> Sheet:
    random, answers = np.random.default_rng([seed, number]), list[RatedPhase]()
    generosity = random.normal(0.0, _GENEROSITY)
    for phase in Phase:
        dominant = PAPER_DOMINANT[phase]
        means = np.array([_PREFERRED if one == dominant else _OTHER for one in views])
        felt = means + generosity + random.normal(0.0, _NOISE, len(views))
        points = np.clip(np.rint(felt), LEAST, MOST).astype(int)
        needed_most = views[int(np.argmax(means + random.normal(0.0, _NOISE, len(views))))]
        necessity: dict[str, int | None] = dict(zip(views, points.tolist(), strict=True))
        answers.append(RatedPhase(phase=phase, necessity=necessity, most_critical=needed_most))
    return Sheet(rater=f"simulated-{number:02d}", simulated=True, answers=tuple(answers))


SESSIONS = 3  # at most: a grasp or a release may be too short for a clip
_NAME = "weights"


def record_session(config_path: Path | None, directory: Path, seed: int) -> Path:
    """Run one pick-and-place of the scripted operator at full quality; its folder.

    TamsError if it did not come to its end.
    """
    from tams_app.console.app import run_session

    settings = load_config(
        config_path,
        {
            "rig.enabled": True,
            "rig.operator.kind": "scripted",  # must not depend on this computer's speed
            "name": _NAME,
            "network": "none",
            "seed": seed,
            "headless": True,
            "recording.directory": str(directory),
        },
    )
    before = set(directory.glob(f"*/{LOG_NAME}"))
    run_session(settings, arm_at_once=True)
    (log,) = set(directory.glob(f"*/{LOG_NAME}")) - before
    outcome = read_log(log).outcome
    if outcome is None or not outcome.completed:
        reason = outcome.reason if outcome else "it was ended early"
        raise TamsError(
            f"{log.parent}: the simulated session was not completed ({reason}): run it "
            "again, or with another --seed"
        )
    return log.parent


def check_panel(folder: RatingFolder, views: Sequence[str], seed: int) -> None:
    """ConfigError if the panel prefers views that are not there, or if `folder` holds other
    ratings: of people, or of a panel of another seed.
    """
    if unknown := set(PAPER_DOMINANT.values()) - set(views):
        raise ConfigError(f"--sim: its raters prefer {', '.join(sorted(unknown))}: no such view")
    expected = {sheet.rater: sheet for sheet in simulate_panel(views, seed)}
    for known in folder.sheets():
        if not known.simulated:
            raise ConfigError(
                f"{folder.path}: holds ratings of people: give another --folder with --sim"
            )
        sheet = expected.get(known.rater)
        if sheet is None or any(sheet.on(answer.phase) != answer for answer in known.answers):
            raise ConfigError(
                f"{folder.path}: holds ratings of another simulated panel: give another --folder"
            )


def rate_by_panel(folder: RatingFolder, views: Sequence[str], phases: Set[Phase], seed: int) -> str:
    """Let a panel that `check_panel` accepts rate `phases`, in files as people's; what it is."""
    for sheet in simulate_panel(views, seed):
        known = folder.open(sheet.rater, simulated=True)
        for answer in sheet.answers:
            if answer.phase in phases and known.on(answer.phase) is None:
                folder.add(sheet.rater, answer)
    return f"prefers the dominant views of the paper's Table I; seed {seed}"
