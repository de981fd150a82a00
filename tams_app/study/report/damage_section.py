"""Why received SSIM is what it is: how much of it coding takes, and how much loss."""

from __future__ import annotations

from tams_app.study.report.blocks import Block, Paragraph, Picture, Section, Table
from tams_app.study.report.comparing import Measure, compare, others
from tams_app.study.report.paired import Quantity, paired_figure, paired_table
from tams_app.study.report.wording import PHASES, interval, name, number, phase_name
from tams_app.study.results import StudyData, TrialResult, participant_means
from tams_app.study.statistics.intervals import Estimate, bootstrap_mean, mean_interval

_TITLE = "What coding takes, and what loss takes"
_DIGITS = 4


def damage_section(data: StudyData) -> Section:
    """The primary view's received SSIM in two parts, their paired differences, damage by phase."""
    if not any(one.lost_ssim is not None for one in data.results):
        text = "No trial tells which frames were damaged by loss."
        return Section(_TITLE, (Paragraph(text),))
    hit = [network for network in data.plan.networks if _is_hit(data, network)]
    blocks: list[Block] = [
        Paragraph(
            "A frame is damaged if one of its packets came too late or never, or if it was "
            "predicted from a damaged one. Undamaged frames show what coding took; what loss took "
            "is received SSIM minus theirs, phase by phase. This is an observation: keyframes that "
            "loss made necessary count as coding, and undamaged frames are not a random sample. "
            f"{_left_out(data)}"
        ),
        _parts_table(data),
        _figure(data),
        paired_table(
            data,
            f"Received SSIM, {name(data.plan.proposed)} minus the other, in two parts, "
            "95 % intervals",
            _QUANTITIES,
        ),
        *(Paragraph(text) for network in hit for text in _sentences(data, network)),
        *(_share_table(data, network) for network in hit),
    ]
    return Section(_TITLE, tuple(blocks))


def _left_out(data: StudyData) -> str:
    lost = sum(len(one.phases) - len(one.parted_phases) for one in data.results)
    if not lost:
        return "Every phase of every trial has undamaged frames."
    return f"Phases without an undamaged frame ({lost} in all trials) are left out of this section."


def _received(result: TrialResult) -> float | None:
    return result.parted_ssim


def _coding(result: TrialResult) -> float | None:
    return result.coding_ssim


def _lost(result: TrialResult) -> float | None:
    return result.lost_ssim


def _packets(result: TrialResult) -> float | None:
    return result.packets_per_frame


_QUANTITIES = (
    Quantity("Received SSIM", "better →", _received, _DIGITS),
    Quantity("Its part by coding", "better →", _coding, _DIGITS),
    Quantity("Its part by loss", "better →", _lost, _DIGITS),
)


def _is_hit(data: StudyData, network: str) -> bool:
    """Whether loss damaged any frame of a primary view there."""
    return any(
        (one.damaged_fraction(phase) or 0.0) > 0
        for one in data.results
        if one.network == network
        for phase in PHASES
    )


def _parts_table(data: StudyData) -> Table:
    rows = [
        (
            f"{name(network)}, {name(strategy)}",
            *(interval(_mean(data, strategy, network, one.measure), 4) for one in _QUANTITIES),
            interval(_mean(data, strategy, network, _packets), 2),
        )
        for network in data.plan.networks
        for strategy in data.plan.strategies
    ]
    header = ("Condition", "Received", "Undamaged frames", "What loss took", "Packets a frame")
    caption = (
        "Received SSIM of the primary view in two parts, means of the phase means, with 95 % "
        "intervals over participants; and how many packets, each of which can be lost, carry a "
        "frame"
    )
    return Table(caption, header, tuple(rows))


def _figure(data: StudyData) -> Picture:
    caption = (
        f"Received SSIM, {name(data.plan.proposed)} minus the other strategy, and the two parts it "
        "is made of; paired, bootstrapped 95 % intervals over participants."
    )
    return paired_figure(data, "damage", caption, _QUANTITIES, one_scale=True)


def _share_table(data: StudyData, network: str) -> Table:
    def damaged(phase: str) -> Measure:
        return lambda result: result.damaged_fraction(phase)

    rows = tuple(
        (
            phase_name(phase),
            *(
                interval(_resampled(data, strategy, network, damaged(phase)), 3)
                for strategy in data.plan.strategies
            ),
        )
        for phase in PHASES
    )
    header = ("Phase", *(name(one) for one in data.plan.strategies))
    caption = (
        f"Share of damaged frames among those shown of the primary view on {name(network)}, "
        "bootstrapped 95 % intervals over participants"
    )
    return Table(caption, header, rows)


def _sentences(data: StudyData, network: str) -> list[str]:
    """Each comparison as a sum, where there is one."""
    told = []
    for other in others(data):
        parts = [compare(data, other, network, one.measure).estimate for one in _QUANTITIES]
        whole, coding, lost = (
            None if part is None else number(part.value, _DIGITS, signed=True) for part in parts
        )
        if whole is not None:
            told.append(
                f"{name(network)}, {name(data.plan.proposed)} against {name(other)}: "
                f"{coding} by coding and {lost} by loss make {whole}."
            )
    return told


def _resampled(data: StudyData, strategy: str, network: str, measure: Measure) -> Estimate | None:
    """With an interval that stays among the values: shares end at 0 and 1."""
    results = data.of(strategy, network)
    return bootstrap_mean(participant_means(results, [measure(one) for one in results]))


def _mean(data: StudyData, strategy: str, network: str, measure: Measure) -> Estimate | None:
    results = data.of(strategy, network)
    return mean_interval(participant_means(results, [measure(one) for one in results]))
