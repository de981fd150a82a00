"""`run_tams.py calibrate weights`: clips are cut, people rate them, and W is built from that.

Everything is kept in one folder as it comes: `clips/`, `ratings/` and `weights.png`. The wizard can
be left at any question and goes on from there the next time.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.kit import WizardUI
from calibration.options import WeightOptions
from calibration.store import Calibration
from calibration.weights.clips import Clip, ClipFolder, play
from calibration.weights.cutting import RecordedSession, cut_session, open_session
from calibration.weights.fit import assess
from calibration.weights.ratings import (
    LEAST,
    RatedPhase,
    RatingFolder,
    Sheet,
    check_panel,
    rate_by_panel,
)
from calibration.weights.report import (
    calibration_of,
    describe,
    describe_cut,
    evidence_remarks,
    weights_figure,
)
from calibration.wizard import Wizard
from tams_app.errors import ConfigError, SetupError
from tams_app.faces.display import require_display
from tams_app.records import Phase
from tams_app.report.plots import save_figure
from tams_app.session.folder import recording_directory

_CLIPS, _RATINGS, _FIGURE = "clips", "ratings", "weights.png"
SCALE_WORDS = ("not needed", "hardly needed", "useful", "needed", "indispensable")
PHASES_IN_WORDS = {
    Phase.REACH: "the open gripper travels towards the object",
    Phase.ALIGN: "the open gripper comes down over the object",
    Phase.GRASP: "the gripper closes on the object",
    Phase.TRANSPORT: "the object is carried to where it belongs",
    Phase.PRE_RELEASE: "the object is lowered onto its place",
    Phase.RELEASE: "the gripper opens and lets the object go",
}
_NO_ANSWER = "-"


class WeightWizard(Wizard[WeightOptions]):
    """The matrix W from ratings."""

    folder: Path
    _clips: ClipFolder
    _ratings: RatingFolder
    _panel: str | None = None
    _figure: Figure | None = None

    def check(self) -> None:
        ratings = self.options.ratings
        if ratings is not None and not ratings.is_dir():
            raise ConfigError(f"--ratings {ratings}: is no folder of rating files")
        if ratings is not None and self.options.sim:
            raise ConfigError("--ratings are people's: leave out --sim, which simulates raters")

    def prepare(self) -> None:
        options, views = self.options, self.config.video.views
        self.folder = self._chosen_folder().resolve()
        self._clips = ClipFolder(self.folder / _CLIPS)
        self._ratings = RatingFolder(options.ratings or self.folder / _RATINGS, views)
        if options.sim:
            check_panel(self._ratings, views, options.seed)

    def measure(self) -> Calibration | None:
        try:
            return self._measure()
        except KeyboardInterrupt:
            self.ui.print(f"\nEverything so far is kept in {self.folder}.")
            raise

    def drawn(self) -> Figure | None:
        return self._figure

    def _measure(self) -> Calibration | None:
        options = self.options
        views = self.config.video.views
        for log in options.logs:
            self._cut(open_session(log, views))
        clips = self._clips.clips()
        if options.ratings is None and not clips:
            raise ConfigError(
                f"{self._clips.path}: holds no clips yet: name recorded sessions, at best several, "
                "with --from LOG"
            )
        if options.sim:
            phases = {clip.phase for clip in clips}
            self._panel = rate_by_panel(self._ratings, views, phases, options.seed)
        elif options.ratings is None and not self._collect(clips):
            self.ui.print(f"Everything is kept in {self.folder}.")
            return None
        return self._build()

    # --- clips ------------------------------------------------------------------------------

    def _cut(self, session: RecordedSession) -> None:
        self.ui.print(f"Cutting {session.name} into clips, one per phase ({session.shows}).")
        cut = cut_session(session, self._clips, self.ui.progress, self.options.context_s)
        self.ui.print(describe_cut(cut))
        if cut.constrained:
            self.ui.print(
                "These frames suffered from the network. The paper's raters saw full quality: "
                "record with `run --network none`, or with --record-reference."
            )

    # --- ratings ----------------------------------------------------------------------------

    def _collect(self, clips: Sequence[Clip]) -> bool:
        """Let people rate; True once the matrix is wanted, False to stop."""
        if lacking := [phase.value for phase in Phase if all(c.phase is not phase for c in clips)]:
            self.ui.print(
                f"There is no clip of {', '.join(lacking)}: W keeps its present row there."
            )
        in_window = self._has_screen()
        while True:
            raters = len(self._answered())
            whose = "1 rater" if raters == 1 else f"{raters} raters"
            build = {"b": f"build the weights from the answers of {whose}"} if raters else {}
            options = {"r": "a rater rates", **build, "s": "stop here"}
            chosen = self.ui.choice("\nWhat next?", options)
            if chosen != "r":
                return chosen == "b"
            name = self.ui.line(
                "Rater's pseudonym (such as p01; the same name goes on where it stopped):"
            )
            views, seed = self.config.video.views, self.options.seed
            try:
                rate(self.ui, self._ratings, name, clips, views, in_window, seed)
            except ConfigError as error:
                if not self.ui.attended:
                    raise
                self.ui.print(f"{error}.")

    def _has_screen(self) -> bool:
        try:
            require_display()
        except SetupError:
            self.ui.print(
                "There is no display here: open each clip in a player when its path is shown."
            )
            return False
        return True

    # --- the matrix -------------------------------------------------------------------------

    def _answered(self) -> list[Sheet]:
        """The sheets with at least one answer."""
        return [sheet for sheet in self._ratings.sheets() if sheet.answers]

    def _build(self) -> Calibration:
        sheets, views = self._answered(), self.config.video.views
        if not sheets:
            raise ConfigError(f"{self._ratings.path}: holds no ratings yet: let people rate first")
        sessions = self._clips.there()
        remarks = evidence_remarks(sheets, sessions, for_rig=self.config.rig.enabled)
        assessment = assess(sheets, views, self.config.policy.weights.matrix, remarks)
        self.ui.print("\n" + describe(assessment, views))
        self._figure = weights_figure(assessment, sheets, views)
        save_figure(self._figure, self.folder / _FIGURE)
        self.ui.print(f"As a figure: {self.folder / _FIGURE}")
        return calibration_of(assessment, sheets, sessions, self._panel)

    def _chosen_folder(self) -> Path:
        """One folder to come back to for people, a new one for each simulation."""
        options = self.options
        if options.folder is not None:
            return options.folder
        if options.ratings is not None:
            return options.ratings.parent if options.ratings.name == _RATINGS else options.ratings
        directory = recording_directory(self.config)
        if not options.sim:
            return directory / "weights"
        return directory / f"{time.strftime('%Y%m%d-%H%M%S')}-weights-sim"


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
    in_window: bool,
    seed: int,
) -> None:
    """Let `rater` answer on the phases that are not answered yet; each is kept at once.

    `in_window`: clips are played there, else their paths are shown.
    """
    sheet = folder.open(rater)
    order = viewing_order(clips, rater, seed)
    left = [(phase, shown) for phase, shown in order if sheet.on(phase) is None]
    if not left:
        ui.print(f"{rater} has rated every phase. Thank you. The ratings stay as they are.")
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
        _watch(ui, shown, in_window)
        folder.add(rater, _ask(ui, phase, views))
    ui.print(f"\nThat was all. Thank you, {rater}.")


def _watch(ui: WizardUI, clips: Sequence[Clip], in_window: bool) -> None:
    while True:
        for number, clip in enumerate(clips, 1):
            ui.print(f"Clip {number} of {len(clips)}, {clip.seconds:.1f} s.")
            if in_window:
                play(clip.path)
            else:
                ui.print(f"Please watch {clip.path}")
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
