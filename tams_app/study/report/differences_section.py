"""Every paired difference with its interval, as one figure and one table."""

from __future__ import annotations

from tams_app.study.report.blocks import Section, Table
from tams_app.study.report.comparing import compare, others
from tams_app.study.report.paired import Quantity, paired_figure, paired_table
from tams_app.study.report.summary_section import received_ssim, success_share
from tams_app.study.report.wording import interval, name
from tams_app.study.results import StudyData, TrialResult
from tams_app.study.statistics.pairs import Key, PairedDifference, paired_difference


def differences_section(data: StudyData) -> Section:
    """The proposed strategy minus each other one, on every network."""

    def censored_s(result: TrialResult) -> float | None:
        return result.censored_time_s(data.limit_s)

    quantities = (
        Quantity("Received SSIM", "better →", received_ssim, 4),
        Quantity(f"Time, censored at {data.limit_s:g} s [s]", "← better", censored_s, 2),
        Quantity("Success [share]", "better →", success_share, 3),
    )
    proposed = name(data.plan.proposed)
    drawn = (
        f"{proposed} minus the other strategy over pairs of trials with the same scene, noise and "
        "losses; bootstrapped 95 % intervals over participants."
    )
    listed = f"Paired differences, {proposed} minus the other, 95 % intervals"
    return Section(
        "Paired differences",
        (
            paired_figure(data, "differences", drawn, quantities),
            paired_table(data, listed, quantities),
            _sensitivity_table(data),
        ),
    )


def _sensitivity_table(data: StudyData) -> Table:
    """The same difference of received SSIM, meant in other ways."""
    rows = []
    for network in data.plan.networks:
        for other in others(data):
            found = (
                compare(data, other, network, received_ssim),
                _on_common_phases(data, other, network),
                compare(data, other, network, lambda one: one.time_weighted_ssim),
                compare(data, other, network, lambda one: one.all_views_ssim),
            )
            cells = (interval(one.estimate, 4, signed=True) for one in found)
            rows.append((f"{name(network)}, against {name(other)}", *cells))
    header = (
        "Comparison",
        "Primary view, mean of the phases",
        "… of the phases that both trials have",
        "… of phases weighed by their time",
        "All views, all frames",
    )
    caption = (
        f"Received SSIM, {name(data.plan.proposed)} minus the other, taken in other ways; 95 % "
        "intervals. The last tells what the other views pay"
    )
    return Table(caption, header, tuple(rows))


def _on_common_phases(data: StudyData, other: str, network: str) -> PairedDifference:
    """Where one trial of a pair lacks a phase, the other's is left out too."""
    first, second = (
        {(one.participant, one.trial.repetition): one for one in data.of(strategy, network)}
        for strategy in (data.plan.proposed, other)
    )
    differences: dict[Key, float] = {}
    for key in first.keys() & second.keys():
        steps = [
            mine - its
            for phase in first[key].phases
            if (mine := first[key].primary_ssim("received_ssim", phase)) is not None
            and (its := second[key].primary_ssim("received_ssim", phase)) is not None
        ]
        if steps:
            differences[key] = sum(steps) / len(steps)
    return paired_difference(differences, dict.fromkeys(differences, 0.0))
