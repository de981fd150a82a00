"""What was run, what is missing, and on what it depends."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tams_app.study.plan import AttemptState, ParticipantState
from tams_app.study.planning import balance_sentence
from tams_app.study.report.blocks import Block, Listing, Paragraph, Section, Table
from tams_app.study.report.wording import PHASES, counted, listed, name, phase_name
from tams_app.study.results import StudyData


def design_section(data: StudyData, tolerance_ssim: float | None) -> Section:
    """Counts, balance, missing trials and phases, void trials with reasons, machines.

    `tolerance_ssim`: how far SSIM may differ on other processors, where it was measured.
    """
    blocks: list[Block] = [
        Paragraph(_who(data)),
        Paragraph(balance_sentence(data.plan), verdict=True),
        _counts(data),
        Paragraph(_missing_trials(data)),
        Paragraph(_phase_lengths(data)),
        Paragraph(_missing_phases(data)),
    ]
    if not_counted := _not_counted(data):
        blocks += [Paragraph("Attempts that do not count:"), Listing(not_counted)]
    blocks.append(Paragraph(_machines(data, tolerance_ssim)))
    return Section("What was run", tuple(blocks))


def _who(data: StudyData) -> str:
    plan = data.plan
    here = sum(one.state is ParticipantState.TAKES_PART for one in plan.participants)
    forgotten = len(plan.participants) - here
    kind = (
        "A simulated operator did every trial; each participant is a draw of his parameters, "
        "not a person. Figures of people are the paper's and are labelled so."
        if plan.simulated
        else "People did the trials, under pseudonyms."
    )
    strategies = listed([name(one) for one in plan.strategies])
    networks = listed([name(one) for one in plan.networks])
    return (
        f"{kind} {counted(here, 'participant')}, strategies {strategies}, networks {networks}, "
        f"repetitions: {plan.repetitions}, study seed {plan.seed}. Within a participant, network "
        "and repetition all strategies share scene, noise and losses."
        + (
            f" Forgotten at their request: {counted(forgotten, 'participant')}."
            if forgotten
            else ""
        )
        + (
            f" Not analysed: {counted(len(data.practice), 'practice trial')}."
            if data.practice
            else ""
        )
    )


def _counts(data: StudyData) -> Table:
    rows = tuple(
        (name(strategy), *(str(len(data.of(strategy, net))) for net in data.plan.networks))
        for strategy in data.plan.strategies
    )
    header = ("Strategy", *(name(one) for one in data.plan.networks))
    return Table("Trials analysed", header, rows)


def _missing_trials(data: StudyData) -> str:
    missing = [one.id for one in data.plan.left if not one.practice] + list(data.unreadable)
    if not missing:
        return "No planned trial is missing."
    return f"Missing: {counted(len(missing), 'planned trial')}: {', '.join(sorted(missing))}."


def _missing_phases(data: StudyData) -> str:
    lacking: Counter[str] = Counter()
    for result in data.results:
        lacking.update(phase for phase in PHASES if phase not in result.phases)
    if not lacking:
        return "Every trial has a scored frame of the primary view in every phase."
    found = [f"{phase_name(phase)} in {lacking[phase]}" for phase in PHASES if lacking[phase]]
    return (
        f"Phases without a scored frame of the primary view: {listed(found)} of "
        f"{len(data.results)} trials; a trial's mean is over the phases it has."
    )


def _phase_lengths(data: StudyData) -> str:
    lasted_s = {
        phase: float(np.median([one.phase_seconds.get(phase, 0.0) for one in data.results]))
        for phase in PHASES
    }
    told = [f"{phase_name(phase)} {seconds:.2f} s" for phase, seconds in lasted_s.items()]
    return f"Phases lasted, medians over all trials: {listed(told)}."


def _not_counted(data: StudyData) -> tuple[str, ...]:
    silent = (AttemptState.DONE, AttemptState.STARTED)
    return tuple(
        f"{trial.id}: {attempt.state.value}, {attempt.reason or 'no reason given'}"
        + (" (done since)" if trial.is_done else "")
        for trial in data.plan.trials
        for attempt in trial.attempts
        if attempt.state not in silent
    )


def _machines(data: StudyData, tolerance_ssim: float | None) -> str:
    kinds = Counter(result.machine.get("processor") or "unknown" for result in data.results)
    versions = sorted({str(result.summary.get("version")) for result in data.results})
    ran = listed([f"{kind} ({counted(count, 'trial')})" for kind, count in kinds.most_common()])
    text = f"TAMS {listed(versions) or 'unknown'}; processors: {ran or 'none'}."
    if not data.plan.simulated:
        return text
    tolerance = (
        f"within {tolerance_ssim:g} in SSIM, as measured"
        if tolerance_ssim is not None
        else "by an amount that this study did not measure"
    )
    return (
        f"{text} On one machine the same seed gives the same bits. Encoder and decoder choose "
        f"instructions by the processor, so another kind may differ, {tolerance}."
    )
