"""`run_tams.py calibrate weights`: clips are cut, people rate them, and W is built from that.

Everything is kept in one folder as it comes: `clips/`, `ratings/` and `weights.png`. The wizard can
be left at any question and goes on from there the next time.
"""

from __future__ import annotations

import time
from pathlib import Path

from matplotlib.figure import Figure
from rich.text import Text

from calibration.options import WeightOptions
from calibration.store import Calibration
from calibration.weights.clips import ClipFolder, play
from calibration.weights.cutting import RecordedSession, cut_session, open_session
from calibration.weights.fit import Assessment, assess
from calibration.weights.panel import SESSIONS, check_panel, rate_by_panel, record_session
from calibration.weights.ratings import RatingFolder, Sheet, Show, rate
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


class WeightWizard(Wizard[WeightOptions]):
    """The matrix W from ratings."""

    folder: Path
    _clips: ClipFolder
    _ratings: RatingFolder
    _panel: str | None = None
    _built: tuple[Assessment, list[Sheet]] | None = None

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
        if self._built is None:
            return None
        return weights_figure(*self._built, self.config.video.views)

    def _measure(self) -> Calibration | None:
        options = self.options
        if options.sim and not options.logs:
            self._record()
        for log in options.logs:
            self._cut(open_session(log, self.config.video.views))
        if options.sim:
            phases = {clip.phase for clip in self._clips.clips()}
            views = self.config.video.views
            self._panel = rate_by_panel(self._ratings, views, phases, options.seed)
        elif options.ratings is None and not self._collect():
            self.ui.print(f"Everything is kept in {self.folder}.")
            return None
        return self._build()

    # --- clips ------------------------------------------------------------------------------

    def _record(self) -> None:
        """Simulated sessions until every phase has a clip, but no more than SESSIONS of them."""
        for number in range(SESSIONS):
            self.ui.print("\nA session on the simulated rig, at full quality, to cut clips from:")
            seed = self.options.seed + number
            log = record_session(self.options.config, self.folder, seed)
            self._cut(open_session(log, self.config.video.views))
            if {clip.phase for clip in self._clips.clips()} == set(Phase):
                return

    def _cut(self, session: RecordedSession) -> None:
        self.ui.print(f"Cutting {session.name} into clips, one per phase ({session.shows}).")
        cut = cut_session(session, self._clips, self.ui.progress, self.options.context_s)
        self.ui.show(Text(""))
        self.ui.print(describe_cut(cut))
        if cut.constrained:
            self.ui.print(
                "These frames suffered from the network. The paper's raters saw full quality: "
                "record with `run --network none`, or with --record-reference."
            )

    # --- ratings ----------------------------------------------------------------------------

    def _collect(self) -> bool:
        """Let people rate; True once the matrix is wanted, False to stop."""
        clips = self._clips.clips()
        if not clips:
            raise ConfigError(
                f"{self._clips.path}: holds no clips yet: name recorded sessions, at best several, "
                "with --from LOG"
            )
        if lacking := [phase.value for phase in Phase if all(c.phase is not phase for c in clips)]:
            self.ui.print(
                f"There is no clip of {', '.join(lacking)}: W keeps its present row there."
            )
        show = self._screen()
        while True:
            raters = len(self._answered())
            whose = "1 rater" if raters == 1 else f"{raters} raters"
            build = {"b": f"build the weights from the answers of {whose}"} if raters else {}
            options = {"r": "a rater rates", **build, "s": "stop here"}
            chosen = self.ui.choice("\nWhat next?", options)
            if chosen != "r":
                return chosen == "b"
            name = self.ui.text(
                "Rater's pseudonym (such as p01; the same name goes on where it stopped):"
            )
            views, seed = self.config.video.views, self.options.seed
            try:
                rate(self.ui, self._ratings, name, clips, views, show, seed)
            except ConfigError as error:
                if not self.ui.attended:
                    raise
                self.ui.print(f"{error}.")

    def _screen(self) -> Show:
        """A window if there is a display; else the clips' paths."""
        try:
            require_display()
        except SetupError:
            self.ui.print(
                "There is no display here: open each clip in a player when its path is shown."
            )
            return lambda path: self.ui.print(f"Please watch {path}")
        return play

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
        self._built = assessment, sheets
        save_figure(weights_figure(assessment, sheets, views), self.folder / _FIGURE)
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
