"""A trial with a person: what it leaves, how it ends, and what the screen does not tell."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from msgspec.structs import replace

from tams_app.config import Config, load_config
from tams_app.errors import ConfigError, HelperError, TamsError
from tams_app.faces.commands import Command
from tams_app.faces.shown import trial_texts
from tams_app.faces.terminal.line import COLUMNS
from tams_app.printing import Console
from tams_app.recording import read_log
from tams_app.session.session import Outset
from tams_app.study import live_trial
from tams_app.study.guided import DROPS_FACT, PLACED_FACT
from tams_app.study.live_trial import LiveTrial, LiveTrialRunner
from tests.faces.terminal.test_line import STATE
from tests.study.synthetic_study import planned_trial

pytestmark = pytest.mark.timed

TRIAL = planned_trial("P01-03", "static", "s3")
REVEALING = re.compile(r"static|equal|tams|s3|kbit|\d ms|queue|ssim|weight|target", re.IGNORECASE)


class Screen(Console):
    def __init__(self) -> None:
        self.output = io.StringIO()
        super().__init__(file=self.output, width=200)

    @property
    def text(self) -> str:
        return self.output.getvalue()


def rig(**overrides: Any) -> Config:
    """The simulated rig: its operator arms and moves the arm as a person would."""
    chosen = {"headless": True, "recording.min_free_mb": 1.0, "rig.operator.kind": "scripted"}
    return load_config(None, {**chosen, **overrides})


@pytest.mark.verify
@pytest.mark.timeout(180)
def test_a_whole_session_is_left_in_the_given_folder_and_the_screen_gives_nothing_away(
    tmp_path: Path,
) -> None:
    screen = Screen()
    LiveTrialRunner(rig(seconds=12.0), screen).run(TRIAL, tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    files = {"session.mcap", "config.yaml", "summary.json", "report.html", "bitrates.png"}
    assert names == files | {"helpers"}
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["strategy"], summary["network"], summary["seed"]) == ("static", "s3", 5)
    log = read_log(tmp_path / "session.mcap")
    assert (log.truncated, log.header.name) == (False, "P01-03")
    assert log.ticks
    assert "p ends it when the block is placed" in screen.text
    assert "trial: " in screen.text
    assert not REVEALING.search(screen.text), screen.text


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Play the session: what it does, and whether it leaves a log."""

    def play(show: Callable[..., None], has_log: bool = True) -> None:
        def write_summary(folder: Path) -> None:
            if not has_log:
                raise TamsError("no log")
            (folder / "summary.json").write_text("{}")

        monkeypatch.setattr(live_trial, "show_session", show)
        monkeypatch.setattr(live_trial, "write_summary", write_summary)

    return play


@pytest.mark.parametrize("has_started", [True, False])
def test_ctrl_c_ends_the_sitting_and_is_no_failed_trial(
    played: Callable[..., None], tmp_path: Path, has_started: bool
) -> None:
    def show(*arguments: Any, **_: object) -> None:
        *_outset_to_lines, signals = arguments
        signals.append("ended by SIGINT")
        if not has_started:
            raise TamsError("ended by SIGINT before it had started")

    played(show)
    with pytest.raises(KeyboardInterrupt):
        LiveTrialRunner(rig(), Screen()).run(TRIAL, tmp_path)
    assert (tmp_path / "summary.json").exists() is has_started


@pytest.mark.parametrize("has_log", [True, False])
def test_a_failed_session_is_a_failed_trial_with_its_own_reason(
    played: Callable[..., None], tmp_path: Path, has_log: bool
) -> None:
    def show(outset: Outset, *_: object, **__: object) -> None:
        outset.failure = "the helper process guard ended unasked"

    played(show, has_log)
    with pytest.raises(TamsError, match=r"^the helper process guard ended unasked$"):
        LiveTrialRunner(rig(), Screen()).run(TRIAL, tmp_path)
    assert (tmp_path / "summary.json").exists() is has_log


def test_a_session_that_cannot_start_says_why(played: Callable[..., None], tmp_path: Path) -> None:
    def show(*_: object, **__: object) -> None:
        raise HelperError("guard could not be started")

    played(show)
    with pytest.raises(TamsError, match="guard could not be started"):
        LiveTrialRunner(rig(), Screen()).run(TRIAL, tmp_path)


def test_a_trial_of_unknown_names_leaves_its_folder_empty(tmp_path: Path) -> None:
    for wrong in ({"strategy": "best"}, {"network": "s9"}):
        with pytest.raises(ConfigError):
            LiveTrialRunner(rig(), Screen()).run(TRIAL.model_copy(update=wrong), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_people_are_not_asked_to_drive_by_frames_that_do_not_show_the_arm(
    tmp_path: Path,
) -> None:
    cameras = {view: {"source": "pattern"} for view in ("eih", "gt", "gs")}
    config = rig(**{"rig.enabled": False, "cameras": cameras})
    with pytest.raises(ConfigError, match="does not show the arm"):
        LiveTrialRunner(config, Screen()).run(TRIAL, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_experimenter_counts_drops_takes_one_back_and_ends_the_trial_as_placed() -> None:
    session = Mock()
    trial = LiveTrial(TRIAL, 120.0, session)
    trial.mark(Command.NO_DROP)
    session.fact.assert_not_called()  # fewer than none
    for command in (Command.DROP, Command.DROP, Command.NO_DROP):
        trial.mark(command)
    assert [one.args[1] for one in session.fact.mock_calls] == ["1", "2", "1"]
    assert [one.args[1] for one in session.note.mock_calls] == ["drops: 1", "drops: 2", "drops: 1"]
    assert trial.facts_of(replace(STATE, arming="ready")).drops == 1
    trial.mark(Command.PLACED)
    session.end.assert_not_called()  # before it has begun
    trial.facts_of(replace(STATE, arming="engaged"))
    trial.mark(Command.PLACED)
    assert dict(one.args for one in session.fact.mock_calls) == {
        DROPS_FACT: "1",
        PLACED_FACT: "yes",
    }
    session.end.assert_called_once_with("the block is placed, says the experimenter")


def test_the_live_line_of_a_trial_tells_the_arm_and_the_time_and_no_more() -> None:
    trial = LiveTrial(TRIAL, 120.0, Mock())
    views = {name: replace(view, live_ssim=0.9) for name, view in STATE.views.items()}
    words = trial.words(replace(STATE, arming="ready", t_s=5.0, primary_view="eih", views=views))
    for text in (words.live, words.plain):
        assert "READY" in text
        assert "trial: not begun, 2:00.0 allowed" in text
        assert not REVEALING.search(text)


def test_the_trial_s_time_runs_from_the_first_engagement_and_its_end_is_told() -> None:
    trial = LiveTrial(TRIAL, 120.0, Mock())
    trial.words(replace(STATE, arming="engaged", t_s=10.0))
    ready = trial.words(replace(STATE, arming="ready", t_s=31.5))
    assert ready.live.endswith("trial: 0:21.5 of 2:00.0")
    late = replace(STATE, arming="holding", phase="PRE_RELEASE", t_s=730.0, last_stop="stale video")
    over = trial.words(late)
    assert over.live.endswith("of 2:00.0: over, end it with q")
    assert len(over.live) <= COLUMNS
    assert over.plain.endswith("last stop: stale video")


def test_the_window_of_a_trial_is_told_who_does_it_and_its_time_and_no_more() -> None:
    trial = LiveTrial(TRIAL, 120.0, Mock())
    ready = replace(STATE, arming="ready", t_s=5.0)
    told = trial.facts_of(ready)
    assert (told.participant, told.passed_s, told.limit_s) == (TRIAL.participant, None, 120.0)
    assert not REVEALING.search(" ".join(trial_texts(told)))
    trial.facts_of(replace(STATE, arming="engaged", t_s=10.0))
    assert trial.facts_of(replace(ready, t_s=31.5)).passed_s == 21.5
