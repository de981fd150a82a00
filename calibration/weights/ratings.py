"""What raters answer about each view in each phase, at the terminal, and the YAML file of each.

rater: p01
simulated: false
scale: [1, 5]
answers:
- {phase: REACH, necessity: {eih: 2, gt: 5, gs: 3}, most_critical: gt}
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, field_validator

from calibration.store import write_text
from calibration.ui import WizardUI
from calibration.weights.clips import Clip, Kept, read_kept
from tams_app.errors import ConfigError
from tams_app.records import Phase

# The paper names neither scale nor wording: five points, the usual choice.
LEAST: Final = 1
MOST: Final = 5
SCALE_WORDS = ("not needed", "hardly needed", "useful", "needed", "indispensable")
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


Show = Callable[[Path], None]

PHASES_IN_WORDS = {
    Phase.REACH: "the open gripper travels towards the object",
    Phase.ALIGN: "the open gripper comes down over the object",
    Phase.GRASP: "the gripper closes on the object",
    Phase.TRANSPORT: "the object is carried to where it belongs",
    Phase.PRE_RELEASE: "the object is lowered onto its place",
    Phase.RELEASE: "the gripper opens and lets the object go",
}
_NO_ANSWER = "-"


def viewing_order(clips: Sequence[Clip], rater: str, seed: int) -> list[tuple[Phase, list[Clip]]]:
    """The phases that have clips, and each one's clips, shuffled for this rater."""
    random = np.random.default_rng([seed, zlib.crc32(rater.encode())])
    phases = [phase for phase in Phase if any(clip.phase is phase for clip in clips)]
    order = []
    for number in random.permutation(len(phases)):
        of_phase = [clip for clip in clips if clip.phase is phases[number]]
        order.append((phases[number], [of_phase[i] for i in random.permutation(len(of_phase))]))
    return order


def rate(
    ui: WizardUI,
    folder: RatingFolder,
    rater: str,
    clips: Sequence[Clip],
    views: Sequence[str],
    show: Show,
    seed: int,
) -> None:
    """Let `rater` answer on the phases that are not answered yet; each is kept at once."""
    sheet = folder.open(rater)
    order = viewing_order(clips, rater, seed)
    left = [(phase, shown) for phase, shown in order if sheet.on(phase) is None]
    if not left:
        ui.print(f"{rater} has rated every phase. Thank you. What was said stays as it is.")
        return
    if sheet.answers:
        before = "1 phase" if len(sheet.answers) == 1 else f"{len(sheet.answers)} phases"
        ui.print(f"{rater} has rated {before} before and goes on from there.")
    ui.print(
        "\nYou will see the robot's work phase by phase, in no particular order, each time through "
        f"all {len(views)} cameras at once, each view's name above it. After each phase, say how "
        "necessary each view is to do that phase well, and which single one you would keep sharp "
        "if the connection could carry only one. There is no right answer. You may stop at any "
        "question with Ctrl-C and go on later under the same name."
    )
    for number, (phase, shown) in enumerate(left, 1):
        ui.print(f"\n{phase.value} ({number} of {len(left)}): {PHASES_IN_WORDS[phase]}.")
        _watch(ui, shown, show)
        folder.add(rater, _ask(ui, phase, views))
    ui.print(f"\nThat was all. Thank you, {rater}.")


def _watch(ui: WizardUI, clips: Sequence[Clip], show: Show) -> None:
    while True:
        for number, clip in enumerate(clips, 1):
            ui.print(f"Clip {number} of {len(clips)}, {clip.seconds:.1f} s.")
            show(clip.path)
        if ui.choice("Seen?", {"r": "rate it", "w": "watch again"}) == "r":
            return


def _ask(ui: WizardUI, phase: Phase, views: Sequence[str]) -> RatedPhase:
    """Ask until the rater stands by the answer."""
    scale = {str(point): words for point, words in enumerate(SCALE_WORDS, LEAST)}
    scale[_NO_ANSWER] = "cannot say"
    names = {view.lower(): view for view in views}
    while True:
        necessity: dict[str, int | None] = {}
        for view in views:
            answer = ui.choice(f"{phase.value}: how necessary is {view.upper()}?", scale)
            necessity[view] = None if answer == _NO_ANSWER else int(answer)
        options = {key: view.upper() for key, view in names.items()} | {_NO_ANSWER: "cannot say"}
        named = ui.choice("Only one view can stay sharp. Which one?", options)
        critical = names.get(named)
        points = ", ".join(f"{view.upper()} {necessity[view] or '-'}" for view in views)
        whole = f"{points}; most critical {critical.upper() if critical else '-'}"
        if ui.yes(f"{phase.value}: {whole}. Keep that? It cannot be changed later."):
            return RatedPhase(phase=phase, necessity=necessity, most_critical=critical)
