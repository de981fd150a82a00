"""`run_tams.py calibrate phases`: from trials with known phases to Algorithm 1's thresholds."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from calibration.kit import as_text, table
from calibration.options import PhaseOptions
from calibration.phases.fit import (
    PHASES,
    SEARCHED,
    PhaseFit,
    Scores,
    check_count,
    evaluate,
    fit_thresholds,
)
from calibration.phases.labels import Material, logged_trials, virtual_trials
from calibration.store import Calibration
from calibration.wizard import Wizard
from tams_app.config import PhasesConfig
from tams_app.errors import ConfigError

_DEFAULT_TRIALS = 10
POOR_RECALL = 0.5


class PhaseWizard(Wizard[PhaseOptions]):
    """The thresholds of Algorithm 1; asks nothing."""

    _count: int

    def check(self) -> None:
        options = self.options
        self._count = _DEFAULT_TRIALS if options.trials is None else options.trials
        if options.sim == bool(options.logs):
            raise ConfigError("say where the trials come from: --sim, or --from LOG (repeatable)")
        if not options.sim and (options.trials is not None or options.held_out is not None):
            raise ConfigError("--trials and --held-out are for --sim: logs are given with --from")
        check_count(len(options.logs) or self._count)

    def measure(self) -> Calibration:
        """Fit the thresholds to the trials; TamsError if nothing can be learned from them."""
        material = self._trials()
        self.store.check_before(self.ui, self.yes, material.simulated)
        smoothing_ms = self.config.policy.phases.smoothing_ms
        found = fit_thresholds(material.trials, smoothing_ms, self.ui.progress)
        held_out = None
        if unseen := material.held_out:
            held_out = evaluate(unseen, found.thresholds), evaluate(unseen, PhasesConfig())
        self.ui.print(as_text("", thresholds_table(found), "", accuracy_table(found, held_out)))
        for remark in remarks(found):
            self.ui.print(f"\nNote: {remark}")
        chosen = {name: getattr(found.thresholds, name) for name in SEARCHED}
        return Calibration(
            "phases",
            {"policy": {"phases": chosen}},
            material.source,
            quality(found, held_out),
            simulated=material.simulated,
            unfounded=unfounded(found),
        )

    def _trials(self) -> Material:
        options, count, config = self.options, self._count, self.config
        if options.logs:
            return logged_trials(options.logs, config.policy.phases.smoothing_ms, self.ui.progress)
        unseen = count if options.held_out is None else options.held_out
        seeds = range(options.seed, options.seed + count + unseen)
        return virtual_trials(config, seeds, unseen, self.ui.progress)


def thresholds_table(found: PhaseFit) -> Table:
    """Chosen against default, and how far they moved as each trial was left out."""
    rows = []
    for name in SEARCHED:
        chosen, default = (getattr(one, name) for one in (found.thresholds, PhasesConfig()))
        folds = [getattr(fold, name) for fold in found.folds]
        rows.append((name, f"{chosen:g}", f"{default:g}", f"{min(folds):g} to {max(folds):g}"))
    return table(rows, ("", "chosen", "default", "with one trial left out"))


def accuracy_table(found: PhaseFit, held_out: tuple[Scores, Scores] | None) -> Table:
    """Frame-wise accuracies; `held_out`: chosen and default over trials not learned from."""
    compared = {
        "over the trials learned from": (found.in_sample, found.defaults),
        "each trial with thresholds from the others": (found.left_out, found.defaults),
    }
    if held_out is not None:
        compared["held-out trials"] = held_out
    rows = [
        (name, *(f"{one.accuracy:.3f} ({one.mean_recall:.3f})" for one in pair))
        for name, pair in compared.items()
    ]
    heads = ("frame-wise accuracy (mean recall of the phases)", "calibrated", "defaults")
    return table(rows, heads)


def unfounded(found: PhaseFit) -> str:
    """Why the defaults are as good, a sentence without its full stop; "" if they are not."""
    if found.left_out.accuracy > found.defaults.accuracy:
        return ""
    return (
        "On a trial that they were not learned from such thresholds do no better than the "
        f"defaults ({found.left_out.accuracy:.3f} against {found.defaults.accuracy:.3f})"
    )


def remarks(found: PhaseFit) -> list[str]:
    """What to know before the thresholds are taken over."""
    lines = []
    for phase in PHASES:
        recall = found.left_out.recall(phase)
        if recall is not None and recall < POOR_RECALL:
            lines.append(
                f"{phase.value} is recognised in only {recall:.0%} of its time: the best overall "
                "accuracy gives this phase up; look whether you want that."
            )
    for name in found.at_the_edge:
        value = getattr(found.thresholds, name)
        lines.append(
            f"{name} ended at {value:g}, an end of what is searched: no optimum in between."
        )
    return lines


def quality(found: PhaseFit, held_out: tuple[Scores, Scores] | None) -> dict[str, Any]:
    """The figures to keep with the thresholds; those of phases are of the trials left out."""
    left_out, defaults = found.left_out, found.defaults
    figures: dict[str, Any] = {
        "trials": len(found.folds),
        "ticks": found.in_sample.ticks,
        "accuracy_in_sample": round(found.in_sample.accuracy, 4),
        "accuracy_leave_one_trial_out": round(left_out.accuracy, 4),
        "accuracy_defaults": round(defaults.accuracy, 4),
        "mean_recall_leave_one_trial_out": round(left_out.mean_recall, 4),
        "mean_recall_defaults": round(defaults.mean_recall, 4),
    }
    if held_out is not None:
        chosen, defaults = held_out
        figures |= {
            "held_out_ticks": chosen.ticks,
            "accuracy_held_out": round(chosen.accuracy, 4),
            "accuracy_held_out_defaults": round(defaults.accuracy, 4),
            "mean_recall_held_out": round(chosen.mean_recall, 4),
            "mean_recall_held_out_defaults": round(defaults.mean_recall, 4),
        }
    confusion = zip(PHASES, left_out.confusion.tolist(), strict=True)
    return figures | {
        "confusion_true_by_inferred": {phase.value: row for phase, row in confusion},
        "recall": {phase.value: _rounded(left_out.recall(phase)) for phase in PHASES},
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
