"""Builds the report of a study: one page that carries its figures, and the figures as files."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from tams_app.config.streaming import PhasesConfig
from tams_app.outputs import made_folder, write_file
from tams_app.recording import LOG_NAME, read_log
from tams_app.report.figures import bitrates_figure
from tams_app.report.pages import counted, page_environment, phase_name
from tams_app.report.plots import to_png, to_svg
from tams_app.study.plan import AttemptState, ParticipantState
from tams_app.study.planning import balance_sentence
from tams_app.study.report import drawing, paper
from tams_app.study.report.measures import PARTS, Measures, claims, compared
from tams_app.study.results import PHASES, StudyData
from tams_app.study.statistics import FEWEST_TO_TEST
from tams_app.summary.tables import LogTables
from tams_app.task import judge

HTML_NAME = "report.html"


@dataclass(frozen=True, slots=True)
class Report:
    """The page, and the figures that it carries: PNG by name."""

    html: str
    figures: dict[str, bytes]

    def write(self, directory: Path) -> Path:
        """Write the page and the figures beside it; the page's path. LogError where they cannot."""
        folder = made_folder(directory)
        for name, png in self.figures.items():
            write_file(folder / f"{name}.png", png)
        write_file(folder / HTML_NAME, self.html)
        return directory / HTML_NAME


def build_report(data: StudyData, remarks: str = "", tolerance_ssim: float | None = None) -> Report:
    """The whole report.

    `remarks`: the experimenters' own words, paragraphs apart by an empty line;
    `tolerance_ssim`: how far SSIM may differ between processors, where it was measured.
    """
    measures = Measures(data)
    figures: dict[str, bytes] = {}

    def draw(name: str, figure: Figure) -> Markup:
        """The figure as an element of the page."""
        figures[name] = to_png(figure)
        return to_svg(figure)

    def trial_figure(trial: str) -> Figure:
        return bitrates_figure(LogTables(read_log(data.folders[trial] / LOG_NAME)))

    page = _template().render(
        data=data,
        plan=data.plan,
        config=data.config,
        judge=judge,
        m=measures,
        draw=draw,
        drawing=drawing,
        bitrates_figure=trial_figure,
        example=_example(data),
        remarks=[text.strip() for text in remarks.split("\n\n") if text.strip()],
        tolerance_ssim=tolerance_ssim,
        run=_run_facts(measures),
        claims=claims(measures),
        quantities=compared(data.limit_s),
        parts=PARTS,
    )
    return Report(page, figures)


def _template() -> jinja2.Template:
    environment = page_environment(Path(__file__).parent)
    environment.globals |= {"paper": paper, "PHASES": PHASES, "FEWEST_TO_TEST": FEWEST_TO_TEST}
    return environment.get_template("report.html.j2")


def _run_facts(measures: Measures) -> dict[str, Any]:
    """What was run, what is missing, and on what it depends."""
    data, plan = measures.data, measures.data.plan
    here = sum(one.state is ParticipantState.TAKES_PART for one in plan.participants)
    silent = (AttemptState.DONE, AttemptState.STARTED)
    processors = Counter(data.trials["processor"].fillna("unknown"))
    return {
        "here": here,
        "forgotten": len(plan.participants) - here,
        "planned": sum(not one.practice for one in plan.trials),
        "balance": balance_sentence(plan),
        "missing": sorted(
            [one.id for one in plan.left if not one.practice] + list(data.unreadable)
        ),
        "not_counted": [
            f"{trial.id}: {attempt.state.value}, {attempt.reason or 'no reason given'}"
            + (" (done since)" if trial.is_done else "")
            for trial in plan.trials
            for attempt in trial.attempts
            if attempt.state not in silent
        ],
        "phases_lasted": [
            f"{phase_name(phase)} {seconds:.2f} s"
            for phase, seconds in measures.median_phases_s().items()
        ],
        "unscored": [
            f"{phase_name(phase)} in {count}"
            for phase in PHASES
            if (count := measures.unscored(phase))
        ],
        "processors": [
            f"{kind} ({counted(count, 'trial')})" for kind, count in processors.most_common()
        ],
        "versions": sorted(set(data.trials["version"].dropna())),
        "default_thresholds": data.config.policy.phases == PhasesConfig(),
    }


def _example(data: StudyData) -> dict[str, Any] | None:
    """The first completed trial of the proposed strategy with all six phases, or the like."""
    middle = data.plan.networks[len(data.plan.networks) // 2]
    phases = data.phases[data.phases["received_ssim"].notna()].groupby("trial").size()

    def unfitness(row: dict[str, Any]) -> tuple[bool, ...]:
        return (
            row["strategy"] != data.plan.proposed,
            row["network"] != middle,
            row["completed"] is not True,
            phases.get(row["trial"], 0) != len(PHASES),
        )

    rows = data.trials.to_dict("records")
    logged = [one for one in rows if (data.folders.get(one["trial"], Path()) / LOG_NAME).is_file()]
    return min(logged, key=unfitness, default=None)
