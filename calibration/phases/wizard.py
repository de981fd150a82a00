"""`run_tams.py calibrate phases`: from trials with known phases to Algorithm 1's thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.progress_bar import ProgressBar
from rich.table import Table

from calibration.options import PhaseOptions
from calibration.phases import report
from calibration.phases.fit import (
    LEAST_TRIALS,
    SEARCHED,
    PhaseFit,
    Sensitivity,
    check_count,
    evaluate,
    fit_thresholds,
    sensitivity,
)
from calibration.phases.labels import LabelRules
from calibration.phases.report import save_sensitivity
from calibration.phases.sources import (
    Material,
    check_folders,
    logged_trials,
    marking_of,
    virtual_trials,
)
from calibration.phases.trials import Scores
from calibration.store import Calibration
from calibration.ui import as_text
from calibration.wizard import Wizard
from tams_app.config import PhasesConfig
from tams_app.console.replay.marks import FILE_NAME
from tams_app.console.replay.run import run_replay
from tams_app.errors import ConfigError, SetupError
from tams_app.faces.display import has_display

KIND = "phases"
_DEFAULT_TRIALS = 10

_INTRODUCTION = """\
Algorithm 1 tells the phases of the task from the arm's speed and the gripper. When a tool counts
as still, when as descending, and for how long, depends on the setup: here the four thresholds are
sought with which it agrees best with trials whose phases are known. Ctrl-C ends this at any time,
and nothing is changed."""


class PhaseWizard(Wizard[PhaseOptions]):
    """The four thresholds of Algorithm 1."""

    _material: Material
    _found: PhaseFit | None = None
    _held_out: tuple[Scores, Scores] | None = None
    _curves: Sequence[Sensitivity] = ()

    @property
    def writes(self) -> bool:
        return not self.options.mark

    @property
    def accepts_unfounded(self) -> bool:
        return self.options.accept_unfounded

    def check(self) -> None:
        options = self.options
        if options.sim == bool(options.logs):
            raise ConfigError("say where the trials come from: --sim, or --from LOG (repeatable)")
        if options.mark and options.sim:
            raise ConfigError("--mark is for recorded logs: simulated trials know their phases")
        if not options.sim and (options.trials is not None or options.held_out is not None):
            raise ConfigError("--trials and --held-out are for --sim: logs are given with --from")
        if options.goal_height_mm is not None and not options.goal_height_mm > 0:
            raise ConfigError("--goal-height-mm must be more than 0")
        if options.mark and not has_display():
            raise SetupError(
                "--mark shows each trial in a window: start it where there is a display, or write "
                f"{FILE_NAME} beside the log by hand as docs/calibration/phases.md says"
            )
        if not options.mark:
            check_count(len(options.logs) if options.logs else self._learn_from)
        check_folders(options.logs)

    def measure(self) -> Calibration | None:
        if self.options.mark:
            self._mark()
            return None
        self.ui.print(_INTRODUCTION)
        self._material = self._trials()
        self.store.check_before(self.ui, self.options.yes, self._material.simulated)
        trials, smoothing_ms = self._material.trials, self.config.policy.phases.smoothing_ms
        found = fit_thresholds(trials, smoothing_ms, self._progress)
        if unseen := self._material.held_out:
            self._held_out = evaluate(unseen, found.thresholds), evaluate(unseen, PhasesConfig())
        self._found = found
        self._show(found)
        self._curves = sensitivity(trials, found.thresholds, self._progress)
        return self.partial()

    def partial(self) -> Calibration | None:
        if self._found is None:
            return None
        return Calibration(
            KIND,
            {
                "policy": {
                    "phases": {name: getattr(self._found.thresholds, name) for name in SEARCHED}
                }
            },
            self._material.source,
            report.quality(self._found, self._held_out),
            simulated=self._material.simulated,
            unfounded=report.unfounded(self._found),
        )

    def draw(self, path: Path) -> None:
        if self._curves:
            save_sensitivity(self._curves, path)

    @property
    def _learn_from(self) -> int:
        """How many simulated trials."""
        return _DEFAULT_TRIALS if self.options.trials is None else self.options.trials

    def _mark(self) -> None:
        """Marks for each log in turn, in its replay."""
        smoothing_ms = self.config.policy.phases.smoothing_ms
        for folder in self.options.logs:
            self.ui.print(f"\n{folder}: mark its phases in the window; Q when it is done.")
            run_replay(folder, marking_of=partial(marking_of, folder, smoothing_ms))
            self.ui.print(f"Its marks are kept in {folder / FILE_NAME}.")
        self.ui.print(
            f"Once at least {LEAST_TRIALS} trials are marked, give them all without --mark."
        )

    def _trials(self) -> Material:
        options, height_mm = self.options, self.options.goal_height_mm
        rules = LabelRules() if height_mm is None else LabelRules(goal_height=height_mm / 1000)
        if options.logs:
            smoothing_ms = self.config.policy.phases.smoothing_ms
            return logged_trials(options.logs, smoothing_ms, rules, self._progress)
        count = self._learn_from
        unseen = count if options.held_out is None else options.held_out
        seeds = range(options.seed, options.seed + count + unseen)
        self.ui.print(
            f"{count} simulated trials to learn from, {unseen} held out; a few seconds each."
        )
        return virtual_trials(self.config, seeds, unseen, rules, self._progress)

    def _show(self, found: PhaseFit) -> None:
        self.ui.print(
            as_text(
                "",
                report.thresholds_table(found),
                "",
                report.accuracy_table(found, self._held_out),
                "\nEach trial with the thresholds that the others give, in control ticks:",
                report.confusion_table(found.left_out),
                "",
                report.switches_table(found.left_out),
                "\nThe same trials with the defaults, the paper's Algorithm 1 as configured:",
                report.confusion_table(found.defaults),
            )
        )
        for remark in report.remarks(found):
            self.ui.print(f"\nNote: {remark}")

    def _progress(self, doing: str, part: float) -> None:
        """Show it in the live area."""
        row = Table.grid(padding=(0, 1))
        row.add_row(doing, ProgressBar(total=1.0, completed=part, width=40), f"{part:.0%}")
        self.ui.show(row)
