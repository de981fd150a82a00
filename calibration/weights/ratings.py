"""What raters say: how necessary each view is in a phase, and which one is the most critical."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Phase

# The paper names neither scale nor wording: five points, the usual choice.
LEAST, MOST = 1, 5
SCALE_WORDS = {
    1: "not needed",
    2: "hardly needed",
    3: "useful",
    4: "needed",
    5: "indispensable",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """One rater on one phase: whole numbers LEAST..MOST by view, None where he cannot say."""

    phase: Phase
    necessity: Mapping[str, int | None]
    most_critical: str | None  # the one view to keep sharp under a severe bandwidth limit


@dataclass(frozen=True, slots=True)
class Sheet:
    """All that one rater has said so far, at most one answer a phase."""

    rater: str  # a pseudonym
    simulated: bool
    answers: tuple[Answer, ...]

    def on(self, phase: Phase) -> Answer | None:
        """His answer on `phase`, None if he gave none."""
        return next((answer for answer in self.answers if answer.phase is phase), None)


def answers_on(sheets: Sequence[Sheet], phase: Phase) -> list[Answer]:
    """What was said about one phase, in the order of `sheets`."""
    return [answer for sheet in sheets if (answer := sheet.on(phase)) is not None]


def necessity_table(sheets: Sequence[Sheet], views: Sequence[str]) -> NDArray[np.float64]:
    """Necessity, shape (raters, phases, views), NaN where nothing was said."""
    table = np.full((len(sheets), len(Phase), len(views)), np.nan)
    for row, sheet in enumerate(sheets):
        for answer in sheet.answers:
            for column, view in enumerate(views):
                value = answer.necessity.get(view)
                if value is not None:
                    table[row, list(Phase).index(answer.phase), column] = value
    return table


def critical_table(sheets: Sequence[Sheet], views: Sequence[str]) -> NDArray[np.float64]:
    """The number of the most critical view, shape (raters, phases), NaN where none was named."""
    table = np.full((len(sheets), len(Phase)), np.nan)
    for row, sheet in enumerate(sheets):
        for answer in sheet.answers:
            if answer.most_critical is not None:
                table[row, list(Phase).index(answer.phase)] = views.index(answer.most_critical)
    return table
