"""How well Algorithm 1 tells the phase with our constants and with those of `preset: reference`.

`python -m benchmarks.experiments.phase_constants FOLDER...` takes recorded sessions whose phases
are known: of the rig, by where things were, or with marks beside the log. For each set of
constants it prints the accuracy of the control ticks with the mean recall of the phases, and each
phase's recall.
`study run --sim` leaves such sessions, in `DIR/trials/*/*`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.table import Table

from calibration.kit import quiet
from calibration.phases.fit import PHASES, Scores, evaluate
from calibration.phases.labels import logged_trials
from tams_app.config import PhasesConfig, load_config
from tams_app.printing import Console


def variants() -> dict[str, PhasesConfig]:
    """Ours, theirs, and theirs with our smoothing."""
    theirs = load_config(overrides={"preset": "reference"}).policy.phases
    smoothed = theirs.model_copy(update={"smoothing_ms": PhasesConfig().smoothing_ms})
    return {"defaults": PhasesConfig(), "reference": theirs, "reference, smoothed": smoothed}


def scores(folders: list[Path], constants: PhasesConfig) -> Scores:
    """Over all sessions together."""
    material = logged_trials(folders, constants.smoothing_ms, quiet)
    return evaluate(material.trials, constants)


def table_of(found: dict[str, Scores]) -> Table:
    """A row for each set of constants."""
    table = Table("", "accuracy (mean recall)", *(phase.value for phase in PHASES), "ticks")
    for name, one in found.items():
        recalls = map(one.recall, PHASES)
        cells = ["–" if recall is None else f"{recall:.2f}" for recall in recalls]
        table.add_row(name, f"{one.accuracy:.3f} ({one.mean_recall:.3f})", *cells, str(one.ticks))
    table.caption = "recall"
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    found = {name: scores(options.folders, one) for name, one in variants().items()}
    Console(width=180).print(table_of(found))


if __name__ == "__main__":
    main()
