"""`run_tams.py calibrate phases`: from trials with known phases to Algorithm 1's thresholds."""

from __future__ import annotations

from rich.progress_bar import ProgressBar
from rich.table import Table

from calibration.options import PhaseOptions
from calibration.phases import report
from calibration.phases.fit import SEARCHED, check_count, evaluate, fit_thresholds
from calibration.phases.sources import Material, logged_trials, virtual_trials
from calibration.store import Calibration, CalibrationSet
from calibration.ui import WizardUI, as_text
from tams_app.config import Config, PhasesConfig, load_config
from tams_app.errors import ConfigError

_DEFAULT_TRIALS = 10


class PhaseWizard:
    """The thresholds of Algorithm 1; asks nothing."""

    def __init__(self, ui: WizardUI, options: PhaseOptions) -> None:
        self._ui, self._options = ui, options
        self._count = _DEFAULT_TRIALS if options.trials is None else options.trials

    def run(self) -> int:
        """Fit the thresholds to the trials and write them; the exit code.

        ConfigError for options that make no sense, TamsError if nothing can be learned from the
        trials or the result does no better than the defaults.
        """
        ui, options = self._ui, self._options
        if options.sim == bool(options.logs):
            raise ConfigError("say where the trials come from: --sim, or --from LOG (repeatable)")
        if not options.sim and (options.trials is not None or options.held_out is not None):
            raise ConfigError("--trials and --held-out are for --sim: logs are given with --from")
        check_count(len(options.logs) or self._count)
        config = load_config(options.config)
        store = CalibrationSet(options.config, config)
        store.check_before(ui, True, options.sim)
        with ui:
            material = self._trials(config)
            store.check_before(ui, True, material.simulated)
            smoothing_ms = config.policy.phases.smoothing_ms
            found = fit_thresholds(material.trials, smoothing_ms, self._show)
            held_out = None
            if unseen := material.held_out:
                held_out = evaluate(unseen, found.thresholds), evaluate(unseen, PhasesConfig())
            tables = report.thresholds_table(found), "", report.accuracy_table(found, held_out)
            ui.print(as_text("", *tables))
            for remark in report.remarks(found):
                ui.print(f"\nNote: {remark}")
            chosen = {name: getattr(found.thresholds, name) for name in SEARCHED}
            result = Calibration(
                "phases",
                {"policy": {"phases": chosen}},
                material.source,
                report.quality(found, held_out),
                simulated=material.simulated,
                unfounded=report.unfounded(found),
            )
            store.propose(ui, result, yes=True, accept_unfounded=options.accept_unfounded)
        return 0

    def _show(self, doing: str, part: float) -> None:
        row = Table.grid(padding=(0, 1))
        row.add_row(doing, ProgressBar(total=1.0, completed=part, width=40), f"{part:.0%}")
        self._ui.show(row)

    def _trials(self, config: Config) -> Material:
        options, count = self._options, self._count
        if options.logs:
            return logged_trials(options.logs, config.policy.phases.smoothing_ms, self._show)
        unseen = count if options.held_out is None else options.held_out
        seeds = range(options.seed, options.seed + count + unseen)
        return virtual_trials(config, seeds, unseen, self._show)
