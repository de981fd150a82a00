"""What raters answer about each view in each phase, the YAML file of each, and simulated raters.

rater: p01
simulated: false
scale: [1, 5]
answers:
- {phase: REACH, necessity: {eih: 2, gt: 5, gs: 3}, most_critical: gt}
"""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, field_validator

from calibration.store import write_text
from calibration.weights.clips import Kept, read_kept
from tams_app.errors import ConfigError
from tams_app.records import Phase

# The paper names neither scale nor wording: five points, the usual choice.
LEAST: Final = 1
MOST: Final = 5
PSEUDONYM = re.compile(r"[A-Za-z0-9_-]{1,40}")


class RatedPhase(Kept):
    """One rater on one phase: whole numbers LEAST..MOST by view, None for no answer."""

    phase: Phase
    necessity: dict[str, Annotated[int, Field(ge=LEAST, le=MOST, strict=True)] | None]
    most_critical: str | None  # the one view to keep sharp under a severe bandwidth limit


class Sheet(Kept):
    """All that one rater has answered so far, at most one answer a phase."""

    rater: Annotated[str, Field(pattern=f"^{PSEUDONYM.pattern}$")]
    simulated: bool
    scale: tuple[Literal[1], Literal[5]] = (LEAST, MOST)
    answers: tuple[RatedPhase, ...] = ()

    @field_validator("answers", mode="before")
    @classmethod
    def _none_yet(cls, answers: object) -> object:
        """A file written by hand may have nothing under `answers`."""
        return () if answers is None else answers

    def on(self, phase: Phase) -> RatedPhase | None:
        """The answer on `phase`, None if there is none."""
        return next((answer for answer in self.answers if answer.phase is phase), None)


def answers_on(sheets: Sequence[Sheet], phase: Phase) -> list[RatedPhase]:
    """The answers about one phase, in the order of `sheets`."""
    return [answer for sheet in sheets if (answer := sheet.on(phase)) is not None]


def necessity_table(sheets: Sequence[Sheet], views: Sequence[str]) -> NDArray[np.float64]:
    """Necessity, shape (raters, phases, views), NaN where nothing was answered."""
    return np.array(
        [
            [
                [answer and answer.necessity.get(view) for view in views]
                for answer in map(sheet.on, Phase)
            ]
            for sheet in sheets
        ],
        float,  # of None: NaN
    )


def critical_table(sheets: Sequence[Sheet], views: Sequence[str]) -> NDArray[np.float64]:
    """The number of the most critical view, shape (raters, phases), NaN where none was named."""
    numbers: dict[str | None, int] = {view: number for number, view in enumerate(views)}
    return np.array(
        [
            [answer and numbers.get(answer.most_critical) for answer in map(sheet.on, Phase)]
            for sheet in sheets
        ],
        float,
    )


_SUFFIX = ".yaml"
_HEADER = "# The ratings of one person or simulated rater; only ever added to.\n"


class RatingFolder:
    """The raters' files in one folder; `views` are those that must be rated."""

    def __init__(self, path: Path, views: Sequence[str]) -> None:
        self.path = path
        self._views = tuple(views)

    def sheets(self) -> list[Sheet]:
        """What all raters have answered; ConfigError if a file is not as it must be."""
        return [self._read(file) for file in sorted(self.path.glob(f"*{_SUFFIX}"))]

    def open(self, rater: str, simulated: bool = False) -> Sheet:
        """What `rater` has answered so far; a file is made if there is none yet.

        ConfigError if the name cannot be one, or is another kind of rater's.
        """
        if not PSEUDONYM.fullmatch(rater):
            raise ConfigError(
                f"{rater!r} cannot be a rater's name: take a short pseudonym of letters, digits, "
                "- and _, such as p01"
            )
        file = self._file(rater)
        if not file.exists():
            self._write(file, Sheet(rater=rater, simulated=simulated))
        sheet = self._read(file)
        if sheet.simulated != simulated:
            raise ConfigError(f"{file}: belongs to another kind of rater; take another name")
        return sheet

    def add(self, rater: str, answer: RatedPhase) -> None:
        """Add one answer on the disk; ConfigError if this phase is answered already."""
        file = self._file(rater)
        sheet = self._read(file)
        if sheet.on(answer.phase) is not None:
            raise ConfigError(f"{file}: {answer.phase.value} is answered already, and stays so")
        self._write(file, sheet.model_copy(update={"answers": (*sheet.answers, answer)}))

    def _write(self, file: Path, sheet: Sheet) -> None:
        """The whole file; what was there stays until all of it is on the disk."""
        content = sheet.model_dump(mode="json")
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=200)
        write_text(file, _HEADER + text)

    def _file(self, rater: str) -> Path:
        return self.path / f"{rater}{_SUFFIX}"

    def _read(self, file: Path) -> Sheet:
        sheet = read_kept(file, Sheet)
        if sheet.rater != file.stem:
            raise ConfigError(f"{file}: rater: is {sheet.rater}; the file must bear that name")
        phases = [answer.phase for answer in sheet.answers]
        for answer in sheet.answers:
            where = f"{file}: {answer.phase.value}"
            if phases.count(answer.phase) > 1:
                raise ConfigError(f"{where}: is answered twice; keep the first answer")
            if set(answer.necessity) != set(self._views):
                raise ConfigError(f"{where}: necessity must name {', '.join(self._views)}")
            if answer.most_critical not in (*self._views, None):
                raise ConfigError(f"{where}: most_critical must be one of {', '.join(self._views)}")
        return sheet


PAPER_DOMINANT = {
    Phase.REACH: "gt",
    Phase.ALIGN: "eih",
    Phase.GRASP: "eih",
    Phase.TRANSPORT: "gs",
    Phase.PRE_RELEASE: "eih",
    Phase.RELEASE: "eih",
}
_PREFERRED, _OTHER = 4.5, 3.0  # mean necessity
RATERS = 8  # as many as the paper asked
_GENEROSITY, _NOISE = 0.4, 0.7  # standard deviations, in points of the scale


def simulate_panel(views: Sequence[str], seed: int, raters: int = RATERS) -> list[Sheet]:
    """Sheets of raters who are not people, on every phase, whichever have clips.

    They exercise the way from ratings to W, and say nothing about views. A simulated rater feels a
    necessity for each view (its mean in the phase, plus the rater's generosity, plus noise), rounds
    it to the scale, and names the view that feels, noise drawn anew, the most necessary. The panel
    prefers the dominant view of the paper's Table I in each phase and no other.
    """
    return [_sheet(views, number, seed) for number in range(1, raters + 1)]


def _sheet(views: Sequence[str], number: int, seed: int) -> Sheet:
    random, answers = np.random.default_rng([seed, number]), list[RatedPhase]()
    generosity = random.normal(0.0, _GENEROSITY)
    for phase in Phase:
        dominant = PAPER_DOMINANT[phase]
        means = np.array([_PREFERRED if one == dominant else _OTHER for one in views])
        felt = means + generosity + random.normal(0.0, _NOISE, len(views))
        points = np.clip(np.rint(felt), LEAST, MOST).astype(int)
        needed_most = views[int(np.argmax(means + random.normal(0.0, _NOISE, len(views))))]
        necessity: dict[str, int | None] = dict(zip(views, points.tolist(), strict=True))
        answers.append(RatedPhase(phase=phase, necessity=necessity, most_critical=needed_most))
    return Sheet(rater=f"simulated-{number:02d}", simulated=True, answers=tuple(answers))


def check_panel(folder: RatingFolder, views: Sequence[str], seed: int) -> None:
    """ConfigError if the panel prefers views that are not there, or `folder` holds other ratings:
    of people, or of a panel of another seed.
    """
    if unknown := set(PAPER_DOMINANT.values()) - set(views):
        raise ConfigError(f"--sim: its raters prefer {', '.join(sorted(unknown))}: no such view")
    expected = {sheet.rater: sheet for sheet in simulate_panel(views, seed)}
    for known in folder.sheets():
        sheet = expected.get(known.rater) if known.simulated else None
        if sheet is None or any(sheet.on(answer.phase) != answer for answer in known.answers):
            raise ConfigError(
                f"{folder.path}: holds ratings of others: give another --folder with --sim"
            )


def rate_by_panel(folder: RatingFolder, views: Sequence[str], phases: Set[Phase], seed: int) -> str:
    """Let a panel that `check_panel` accepts rate `phases`, in files as people's; what it is."""
    for sheet in simulate_panel(views, seed):
        known = folder.open(sheet.rater, simulated=True)
        for answer in sheet.answers:
            if answer.phase in phases and known.on(answer.phase) is None:
                folder.add(sheet.rater, answer)
    return f"prefers the dominant views of the paper's Table I; seed {seed}"
