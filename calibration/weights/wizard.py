"""The conversation: clips are cut, people rate them, and W is built from what they said.

Everything is kept in one folder as it comes: `clips/`, `ratings/` and `weights.png`. The wizard can
be left at any question and goes on from there the next time.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from rich.text import Text

from calibration.desk import Desk, TerminalDesk
from calibration.store import CalibrationSet
from calibration.weights.assessment import assess
from calibration.weights.clip_file import play
from calibration.weights.clips import ClipFolder
from calibration.weights.cutting import cut_session
from calibration.weights.picture import save_picture
from calibration.weights.rating import Show, rate
from calibration.weights.rating_files import RatingFolder
from calibration.weights.ratings import Sheet
from calibration.weights.report import (
    calibration_of,
    describe,
    describe_cut,
    evidence_remarks,
)
from calibration.weights.segments import Segment
from calibration.weights.simulated import SESSIONS, check_panel, rate_by_panel, record_session
from calibration.weights.sources import RecordedSession, open_session
from tams_app.config import Config, load_config
from tams_app.console.windows import require_display
from tams_app.errors import ConfigError, SetupError
from tams_app.records import Phase
from tams_app.session.folder import recording_directory

_CLIPS, _RATINGS, _PICTURE = "clips", "ratings", "weights.png"


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line said; None: not given."""

    config_path: Path | None = None
    sim: bool = False
    logs: tuple[Path, ...] = ()
    ratings: Path | None = None  # build from these files and ask nobody
    folder: Path | None = None  # where clips and ratings are kept
    panel: str = "paper"
    context_s: float = 0.0  # shown before and after each phase
    seed: int = 0
    yes: bool = False


def run_weights(options: Options, desk: Desk | None = None) -> int:
    """Calibrate the view weights; the exit code. `desk`: the terminal unless given."""
    config = load_config(options.config_path)
    if options.ratings is not None and not options.ratings.is_dir():
        raise ConfigError(f"--ratings {options.ratings}: is no folder of rating files")
    with desk or TerminalDesk() as opened:
        sitting = _Sitting(options, config, opened)
        try:
            return sitting.run()
        except KeyboardInterrupt:
            opened.say(f"\nEverything so far is kept in {sitting.folder}.")
            raise


class _Sitting:
    """One call of the wizard."""

    def __init__(self, options: Options, config: Config, desk: Desk) -> None:
        self._options, self._desk = options, desk
        self._views = config.video.views
        self._present = config.policy.weights.matrix
        self._for_rig = config.rig.enabled
        self._set = CalibrationSet.of(options.config_path, config)
        self.folder = _folder(options, config).resolve()
        self._clips = ClipFolder(self.folder / _CLIPS)
        self._ratings = RatingFolder(options.ratings or self.folder / _RATINGS, self._views)
        self._panel: str | None = None

    def run(self) -> int:
        self._set.check_before(self._desk, self._options.yes, self._options.sim)
        if self._options.sim:
            self._check_simulation()
        if self._options.sim and not self._options.logs:
            self._record()
        for log in self._options.logs:
            self._cut(open_session(log, self._views))
        if self._options.sim:
            phases = [clip.phase for clip in self._clips.clips()]
            self._panel = rate_by_panel(
                self._ratings,
                self._options.panel,
                self._views,
                sorted(set(phases), key=list(Phase).index),
                self._options.seed,
            )
        elif self._options.ratings is None and not self._collect():
            self._desk.say(f"Everything is kept in {self.folder}.")
            return 0
        return self._build()

    def _check_simulation(self) -> None:
        """ConfigError for what would make different raters' ratings one."""
        if self._options.ratings is not None:
            raise ConfigError("--ratings are somebody's: leave out --sim, which simulates raters")
        check_panel(self._ratings, self._options.panel, self._views, self._options.seed)

    # --- clips ------------------------------------------------------------------------------

    def _record(self) -> None:
        """Simulated sessions until every phase has a clip, but no more than SESSIONS of them."""
        for number in range(SESSIONS):
            self._desk.say("\nA session on the simulated rig, at full quality, to cut clips from:")
            seed = self._options.seed + number
            log = record_session(self._options.config_path, self.folder, seed)
            self._cut(open_session(log, self._views))
            if {clip.phase for clip in self._clips.clips()} == set(Phase):
                return

    def _cut(self, session: RecordedSession) -> None:
        self._desk.say(f"Cutting {session.name} into clips, one per phase ({session.picture}).")
        cut = cut_session(session, self._clips, self._show_progress, self._options.context_s)
        self._desk.show(Text(""))
        self._desk.say(describe_cut(cut))
        if cut.constrained:
            self._desk.say(
                "These pictures suffered from the network. The paper's raters saw full quality: "
                "record with `run --network none`, or with --record-reference."
            )

    def _show_progress(self, segment: Segment, done: float) -> None:
        self._desk.show(Text(f"{segment.phase.value}: {done:.0%} of {segment.seconds:.1f} s"))

    # --- ratings ----------------------------------------------------------------------------

    def _collect(self) -> bool:
        """Let people rate until somebody wants the matrix; False: until they stop."""
        clips = self._clips.clips()
        if not clips:
            raise ConfigError(
                f"{self._clips.path}: holds no clips yet: name recorded sessions, at best several, "
                "with --from LOG"
            )
        if lacking := [phase.value for phase in Phase if all(c.phase is not phase for c in clips)]:
            self._desk.say(
                f"There is no clip of {', '.join(lacking)}: W keeps its present row there."
            )
        show = _screen(self._desk)
        while True:
            raters = len(self._answered())
            whose = "1 rater" if raters == 1 else f"{raters} raters"
            build = {"b": f"build the weights from the answers of {whose}"} if raters else {}
            options = {"r": "a rater rates", **build, "s": "stop here"}
            chosen = self._desk.conversation.choice("\nWhat next?", options)
            if chosen != "r":
                return chosen == "b"
            name = self._desk.conversation.text(
                "Rater's pseudonym (such as p01; the same name goes on where it stopped):"
            )
            try:
                rate(self._desk, self._ratings, name, clips, self._views, show, self._options.seed)
            except ConfigError as error:
                if not self._desk.attended:
                    raise
                self._desk.say(f"{error}.")

    # --- the matrix -------------------------------------------------------------------------

    def _answered(self) -> list[Sheet]:
        """What the raters have said who have said anything."""
        return [sheet for sheet in self._ratings.sheets() if sheet.answers]

    def _build(self) -> int:
        sheets = self._answered()
        if not sheets:
            raise ConfigError(
                f"{self._ratings.path}: holds no ratings yet: let somebody rate first"
            )
        sessions = self._clips.there()
        assessment = assess(sheets, self._views, self._present).with_remarks(
            evidence_remarks(sheets, sessions, for_rig=self._for_rig)
        )
        self._desk.say("\n" + describe(assessment, self._views))
        picture = self.folder / _PICTURE
        save_picture(assessment, sheets, self._views, picture)
        self._desk.say(f"As a picture: {picture}")
        calibration = calibration_of(assessment, sheets, sessions, self._panel)
        written = self._set.propose(self._desk, calibration, self._options.yes)
        if written is None:
            return 0 if self._desk.attended else 1
        save_picture(assessment, sheets, self._views, written.with_suffix(".png"))
        return 0


def _folder(options: Options, config: Config) -> Path:
    """One folder to come back to for people, a new one for each simulation."""
    if options.folder is not None:
        return options.folder
    if options.ratings is not None:
        return options.ratings.parent if options.ratings.name == _RATINGS else options.ratings
    directory = recording_directory(config)
    if not options.sim:
        return directory / "weights"
    return directory / f"{time.strftime('%Y%m%d-%H%M%S')}-weights-sim"


def _screen(desk: Desk) -> Show:
    """A window if there is a display; else the clips' paths."""
    try:
        require_display()
    except SetupError:
        desk.say("There is no display here: open each clip in a player when its path is shown.")
        return lambda path: desk.say(f"Please watch {path}")
    return play
