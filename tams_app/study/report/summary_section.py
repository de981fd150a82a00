"""What holds and what does not, claim by claim of the paper, decided by the numbers alone."""

from __future__ import annotations

from collections import Counter

from tams_app.study.report.blocks import Block, Listing, Paragraph, Section
from tams_app.study.report.comparing import (
    Finding,
    Measure,
    compare,
    difference_sentence,
    judge,
    others,
)
from tams_app.study.report.wording import counted, name
from tams_app.study.results import StudyData, TrialResult


def received_ssim(result: TrialResult) -> float | None:
    """The paper's quality measure."""
    return result.primary_ssim("received_ssim")


def success_share(result: TrialResult) -> float | None:
    """1 or 0, so that means are shares."""
    return None if result.success is None else float(result.success)


def summary_section(data: StudyData, remarks: str) -> Section:
    """One list of sentences per claim; then what the experimenters remark."""

    def censored_s(result: TrialResult) -> float | None:
        return result.censored_time_s(data.limit_s)

    proposed = name(data.plan.proposed)
    blocks: list[Block] = [
        Paragraph(
            "Each sentence below is made from a 95 % interval of paired differences: trials of one "
            "participant, network and repetition that share scene, noise and losses, averaged per "
            "participant and bootstrapped over participants. A claim holds where the interval "
            "excludes 0 on the claimed side. The intervals are not corrected for their number."
        ),
        *_claim(
            data,
            f"{proposed} gives the higher SSIM of the primary view (received frames).",
            received_ssim,
            more_is_better=True,
            digits=4,
        ),
        *_claim(
            data,
            f"{proposed} shortens the task (times censored at {data.limit_s:g} s).",
            censored_s,
            more_is_better=False,
            digits=2,
            unit=" s",
        ),
        *_claim(
            data,
            f"{proposed} raises the success rate (differences as shares).",
            success_share,
            more_is_better=True,
            digits=3,
        ),
    ]
    blocks += [Paragraph(text.strip()) for text in remarks.split("\n\n") if text.strip()]
    return Section("What holds and what does not", tuple(blocks))


def _claim(
    data: StudyData,
    text: str,
    measure: Measure,
    *,
    more_is_better: bool,
    digits: int,
    unit: str = "",
) -> list[Block]:
    compared = [
        (other, network, compare(data, other, network, measure))
        for network in data.plan.networks
        for other in others(data)
    ]
    sentences = tuple(
        difference_sentence(
            data, other, network, found, more_is_better=more_is_better, digits=digits, unit=unit
        )
        for other, network, found in compared
    )
    findings = Counter(judge(found, more_is_better=more_is_better) for _, _, found in compared)
    tally = ", ".join(f"{one.value}: {findings[one]}" for one in Finding if findings[one])
    return [
        Paragraph(f"Claim: {text} {counted(len(compared), 'comparison')}: {tally}.", verdict=True),
        Listing(sentences),
    ]
