"""Every paired difference with its interval, as one figure and one table."""

from __future__ import annotations

from tams_app.study.report.blocks import Section
from tams_app.study.report.paired import Quantity, paired_figure, paired_table
from tams_app.study.report.summary_section import received_ssim, success_share
from tams_app.study.report.wording import name
from tams_app.study.results import StudyData, TrialResult


def differences_section(data: StudyData) -> Section:
    """The proposed strategy minus each other one, on every network."""

    def censored_s(result: TrialResult) -> float | None:
        return result.censored_time_s(data.limit_s)

    by_time = Quantity("Received SSIM, phases by their time", "better →", _time_weighted, 4)
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
            paired_table(data, listed, (quantities[0], by_time, *quantities[1:])),
        ),
    )


def _time_weighted(result: TrialResult) -> float | None:
    """Where trials of a pair have not the same phases, this cannot be moved by a short one."""
    return result.time_weighted_ssim
