"""A replay shows what the log says of the moment where it is."""

from __future__ import annotations

import shutil
from collections import Counter
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest

from tams_app.cli import _main
from tams_app.config import load_config
from tams_app.console.replay.log_index import LogIndex
from tams_app.console.replay.marks import Mark, Marking, read_marks
from tams_app.console.replay.run import _shown_config
from tams_app.console.replay.session import ReplaySession
from tams_app.faces.messages import Keys
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.prediction.present import PREDICTED_FACT
from tams_app.recording import LOG_NAME, read_log
from tams_app.recording.reader import PictureFinder
from tams_app.records import (
    Episode,
    EpisodesState,
    EpisodeState,
    Note,
    Phase,
    PhaseChange,
    ShownFrame,
)
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.task.judge import PLACED
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.foxglove_messages import viewed_log
from tests.golden_logs import golden_log
from tests.synthetic_session import START_NS, VIEWS, Synthetic, header, tick

pytestmark = pytest.mark.untimed

GREYS = (40, 90, 140, 190)  # of the pictures of each second


def second(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


@pytest.fixture
def log_path(tmp_path: Path) -> Path:
    """Four seconds of ticks, phases, notes and pictures, each second its own."""
    config = load_config()
    clock = VirtualClock(START_NS)
    made = header(config=config.model_dump(mode="json"))
    path = tmp_path / "session.mcap"
    phases = (Phase.REACH, Phase.ALIGN, Phase.GRASP, Phase.TRANSPORT)
    with closing(viewed_log(path, made, clock)) as log:
        for number, (phase, grey) in enumerate(zip(phases, GREYS, strict=True)):
            log.record(PhaseChange(second(number), phase, "a rule"))
            log.record(Note(second(number + 0.5), "info", f"note {number}"))
            for view in VIEWS:
                image = np.full((48, 64, 3), grey, np.uint8)
                shown_ns = second(number + 0.2)
                log.record(
                    ShownFrame(view, 30 * number, shown_ns, image, second(number + 0.1), True)
                )
            for at in range(120 * number, 120 * (number + 1)):
                arming = "holding" if number == 2 else "engaged"
                reason = "stale video" if number == 2 else ""
                log.record(replace(tick(at), arming=arming, reason=reason))
            clock.advance_ns(NS_PER_S)
    return path


class Replayed:
    """A replay in virtual time, and what it has put on the screen."""

    def __init__(
        self, path: Path, tmp_path: Path, speed: float = 1.0, marking: Marking | None = None
    ) -> None:
        self.clock = VirtualClock(0)
        self.presses = Counter[str]()
        self.put: dict[str, float] = {}
        log = read_log(path)
        self.session = ReplaySession(
            log,
            PictureFinder(path),
            load_config(),
            tmp_path,
            speed,
            self.clock,
            " (keys)",
            marking,
        )
        self.session.__enter__()
        self.session.screen.put = (  # type: ignore[method-assign]
            lambda view, _index, _t_ns, image: self.put.update({view: float(image.mean())})
        )

    def passes(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.clock.advance_ns(50 * NS_PER_MS)
            self.session.poll()

    def press(self, *keys: str) -> None:
        for key in keys:
            self.presses[key] += 1
            self.session.on_keys(Keys(self.clock.now_ns(), True, (), presses=dict(self.presses)))


@pytest.fixture
def replayed(log_path: Path, tmp_path: Path) -> Replayed:
    return Replayed(log_path, tmp_path)


@pytest.mark.parametrize("is_cut_off", [False, True])
def test_state_notes_and_pictures_are_those_of_the_moment(
    log_path: Path, tmp_path: Path, is_cut_off: bool
) -> None:
    if is_cut_off:
        log_path.write_bytes(log_path.read_bytes()[:-60])  # of the footer, which names the index
    replayed = Replayed(log_path, tmp_path)
    expected = (("engaged", "REACH"), ("engaged", "ALIGN"), ("holding", "GRASP"))
    for number, (arming, phase) in enumerate(expected):
        replayed.passes(0.9 if number == 0 else 1.0)
        state = replayed.session.state()
        assert (state.arming, state.phase) == (arming, phase)
        assert state.t_s == pytest.approx(0.9 + number, abs=0.06)
        assert set(replayed.put) == set(VIEWS)
        assert all(abs(grey - GREYS[number]) < 3 for grey in replayed.put.values())
        notes = replayed.session.sentences.take()
        assert [note for note in notes if note.startswith("note")] == [f"note {number}"]
    assert replayed.session.state().reason == "stale video"


def test_arrow_keys_go_back_and_the_pictures_with_them(replayed: Replayed) -> None:
    replayed.passes(3.5)
    replayed.press("Home")
    replayed.passes(0.5)
    assert all(abs(grey - GREYS[0]) < 3 for grey in replayed.put.values())
    assert replayed.session.state().reason == ""
    replayed.press("End")
    replayed.passes(0.05)
    assert replayed.session.playback.at_end
    assert not replayed.session.ended.is_set()


def test_a_replay_says_which_views_were_predicted_in_the_session(replayed: Replayed) -> None:
    replayed.session._log.facts[PREDICTED_FACT] = "eih,gt"
    replayed.session.__enter__()
    said = "as received, while the session showed them predicted: eih, gt"
    assert said in replayed.session.sentences.take()


def test_speed_and_pause_are_told_and_kept(log_path: Path, tmp_path: Path) -> None:
    replayed = Replayed(log_path, tmp_path, speed=2.0)
    replayed.passes(0.5)
    assert replayed.session.elapsed_s() == pytest.approx(1.0)
    replayed.session.signals.confirm(0)
    replayed.passes(5.0)
    assert replayed.session.elapsed_s() == pytest.approx(1.0)
    replayed.press("Up")
    replayed.session.signals.confirm(0)
    replayed.passes(0.25)
    assert replayed.session.elapsed_s() == pytest.approx(2.0)
    told = [note for note in replayed.session.sentences.take() if note.startswith("replay")]
    assert [one.partition(" (")[0] for one in told] == [
        "replay: goes on, 2 times the real speed",
        "replay: paused, 2 times the real speed",
        "replay: goes on, 4 times the real speed",
    ]


def test_a_confirmation_pauses_and_goes_on_and_an_emergency_stop_pauses(
    log_path: Path, tmp_path: Path
) -> None:
    session = (replayed := Replayed(log_path, tmp_path)).session
    paused = []
    confirm = partial(session.signals.confirm, 0)
    for ask in (confirm, confirm, session.signals.estop, session.signals.estop):
        ask()
        replayed.passes(0.05)
        paused.append(session.facts().paused)
    assert paused == [True, False, True, True]


def test_it_goes_where_the_bar_is_clicked_and_says_what_was_said_last_there(
    replayed: Replayed,
) -> None:
    session = replayed.session
    replayed.passes(0.3)
    session.sentences.take()
    for t_s, note in ((3.6, "note 3"), (1.6, "note 1"), (1.8, None), (3.7, "note 3")):
        session.seek(t_s)
        replayed.passes(0.05)
        assert session.state().t_s == pytest.approx(t_s + 0.05)
        assert all(abs(grey - GREYS[int(t_s)]) < 3 for grey in replayed.put.values())
        assert session.sentences.take() == ([] if note is None else [note])
    assert session.facts().jumps == 4


def test_after_a_seek_the_rates_of_the_minute_before_are_those_of_the_log(
    replayed: Replayed, log_path: Path
) -> None:
    replayed.passes(0.3)
    assert replayed.session.facts().past == ()
    replayed.session.seek(3.6)
    replayed.passes(0.05)
    past = replayed.session.facts().past
    assert [state.t_s for state in past] == [0.0, 1.0, 2.0, 3.0]
    moments = LogIndex(read_log(log_path))
    for state in past:
        there = moments.at(START_NS + round(state.t_s * NS_PER_S))
        assert {name: view.sent_kbps for name, view in state.views.items()} == {
            name: view.sent_kbps for name, view in there.views.items()
        }
        assert state.estimate_kbps == there.estimate_kbps


def test_the_block_is_placed_from_when_that_was_said(log_path: Path) -> None:
    log = read_log(log_path)
    log.notes.append(Note(START_NS + 2 * NS_PER_S, "info", f"{PLACED}: go on"))
    placed = [LogIndex(log).at(START_NS + t_s * NS_PER_S).placed for t_s in (1, 2, 3)]
    assert placed == [False, True, True]


def test_no_picture_of_another_moment_stays_where_there_was_none(replayed: Replayed) -> None:
    replayed.passes(2.0)
    assert all(replayed.put[view] > 30 for view in VIEWS)
    replayed.press("Home")
    replayed.passes(0.05)
    assert replayed.put == dict.fromkeys(VIEWS, 0.0)


def test_a_key_that_is_held_acts_once_and_each_press_that_is_told_with_others(
    replayed: Replayed,
) -> None:
    for _ in range(20):
        replayed.session.on_keys(Keys(0, True, (), presses={"Up": 1, "Page_Down": 3}))
    replayed.passes(0.05)
    assert replayed.session.playback.speed == 2.0
    assert replayed.session.elapsed_s() == pytest.approx(0.3)


def test_rates_ages_and_frames_are_those_that_the_log_has() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    early, late = (LogIndex(log).at(second(t_s)) for t_s in (2.5, 5.5))
    view = log.header.views[0]
    assert early.views[view].target_kbps == 1000
    assert late.views[view].target_kbps == 3000
    assert early.views[view].sent_kbps == pytest.approx(1000, rel=0.1)
    assert late.views[view].sent_kbps == pytest.approx(3000, rel=0.1)
    assert early.views[view].given_fps == pytest.approx(30, abs=1)
    assert early.link_kbps == pytest.approx(
        sum(one.sent_kbps or 0.0 for one in early.views.values()), rel=0.05
    )
    assert early.views[view].latency_ms is not None
    assert early.views[view].age_ms is not None
    assert early.views[view].age_ms >= early.views[view].latency_ms


def test_the_episodes_are_those_of_the_moment_by_their_newest_verdict() -> None:
    log = Synthetic(6.0).log()
    assert LogIndex(log).at(second(1.0)).episodes is None
    first = Episode(second(2), 1, second(1), second(2))
    other = Episode(second(4), 2, second(3), second(4), True, True)
    log.episodes = [first, replace(first, t_ns=second(2.5), kept=False), other]
    before, within, after = (LogIndex(log).at(second(t_s)).episodes for t_s in (0.5, 3.25, 5.0))
    assert before == EpisodesState(1, "idle")
    discarded, labelled = EpisodeState(1, 1.0, False), EpisodeState(2, 1.0, True, True)
    assert within == EpisodesState(2, "recording", 0.25, "", 0, 1, (discarded,))
    assert after == EpisodesState(3, "idle", 0.0, "", 1, 1, (discarded, labelled))


def test_before_the_first_record_nothing_is_known() -> None:
    state = LogIndex(Synthetic(1.0).log()).at(START_NS - NS_PER_S)
    assert (state.arming, state.tcp_mm, state.reason) == ("starting", None, "")
    assert state.loss is None
    assert all(view.target_kbps is None for view in state.views.values())


def test_a_replay_without_a_window_ends_with_the_log_and_tells_what_keys_and_log_lack(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(golden_log("outage"), tmp_path / LOG_NAME)
    times_ns = count(0, 50 * NS_PER_MS)  # whatever the machine does meanwhile
    monkeypatch.setattr(MonotonicClock, "now_ns", lambda _clock: next(times_ns))
    for readable in (True, False):
        monkeypatch.setattr(TerminalKeys, "readable", readable)
        monkeypatch.setattr(TerminalKeys, "open", lambda _keys: None)
        assert _main(["replay", str(tmp_path), "--headless", "--speed", "50"]) == 0
        told = capsys.readouterr().out
        assert (
            "goes on, 50 times the real speed (Enter: pause, go on; q: end)\n" in told
        ) == readable
        assert "replay: the end, 50 times the real speed\n" in told
        assert "arrows" not in told
        assert "The log" not in told
    log = tmp_path / LOG_NAME
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    assert _main(["replay", str(tmp_path), "--headless", "--speed", "50"]) == 0
    assert "The log ends early, at " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("{folder}/nowhere",), "there is no such folder"),
        (("{folder}", "--speed", "0"), "--speed: 0 is not between"),
        (("{folder}", "--speed", "nan"), "--speed: nan is not between"),
    ],
)
def test_what_cannot_be_replayed_is_one_sentence(
    log_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    given = [one.format(folder=log_path.parent) for one in arguments]
    assert _main(["replay", *given, "--headless"]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert len(error.splitlines()) == 1


def test_a_replay_is_shown_in_the_window_whatever_showed_the_session() -> None:
    recorded = load_config(overrides={"faces": ["headset", "elsewhere"]})
    assert _shown_config(recorded, headless=False).faces == ("window",)


# --- marking --------------------------------------------------------------------------------------

LAST_S = 479 / 120  # of the ticks


@pytest.fixture
def marks_path(tmp_path: Path) -> Path:
    return tmp_path / "phases.csv"


def test_a_key_marks_the_phase_at_the_moment_shown_and_it_is_on_the_disk_at_once(
    log_path: Path, tmp_path: Path, marks_path: Path
) -> None:
    replayed = Replayed(log_path, tmp_path, marking=Marking(marks_path, LAST_S))
    replayed.press(*["Page_Down"] * 7, "1", *["Page_Down"] * 5, "2")
    replayed.passes(0.05)
    marks = [Mark(0.7, Phase.REACH), Mark(1.2, Phase.ALIGN)]
    assert read_marks(marks_path, LAST_S) == marks
    replayed.press("End", "0")
    replayed.passes(0.05)  # the log ends after its last tick, and no mark may
    assert read_marks(marks_path, LAST_S) == [*marks, Mark(3.991, None)]
    replayed.press("BackSpace", "BackSpace")
    replayed.passes(0.05)
    assert read_marks(marks_path, LAST_S) == marks[:1]
    said = replayed.session.sentences.take()
    assert "marked: ALIGN from 1.20 s on" in said
    assert said[-1] == "not marked any more: ALIGN at 1.20 s"


def test_a_mark_made_just_before_the_end_is_kept(
    log_path: Path, tmp_path: Path, marks_path: Path
) -> None:
    replayed = Replayed(log_path, tmp_path, marking=Marking(marks_path, LAST_S))
    replayed.press("1")
    replayed.session.end("ended by the operator")
    replayed.session.__exit__()
    assert read_marks(marks_path, LAST_S) == [Mark(0.0, Phase.REACH)]


def test_marking_goes_on_paused_from_the_last_mark(
    log_path: Path, tmp_path: Path, marks_path: Path
) -> None:
    marks_path.write_text("t_s,phase\n0.5,REACH\n1.25,ALIGN\n")
    replayed = Replayed(log_path, tmp_path, marking=Marking(marks_path, LAST_S))
    replayed.passes(1.0)
    assert replayed.session.state().t_s == pytest.approx(1.25)
    assert replayed.session.state().phase == "ALIGN"
    assert replayed.session.facts().paused


def test_who_marks_sees_their_marks_and_nothing_that_tells_the_inferred_phase(
    log_path: Path, tmp_path: Path, marks_path: Path
) -> None:
    def shown(marking: Marking | None, *keys: str) -> str:
        session = (replayed := Replayed(log_path, tmp_path, 0.001, marking)).session
        replayed.press(*keys)
        replayed.passes(0.05)
        whole = f"{session.outline} {session.facts()} {session.state()}"
        return " ".join(phase for phase in Phase if phase.value in whole)

    marking = Marking(marks_path, LAST_S)
    assert "REACH ALIGN GRASP" in shown(None)
    assert shown(marking, "End") == ""
    assert shown(marking, "Home", "4") == "TRANSPORT"
    assert Replayed(log_path, tmp_path, 1.0, marking).session.state().primary_view == ""


def test_without_marking_the_keys_of_phases_write_nothing(
    replayed: Replayed, tmp_path: Path
) -> None:
    replayed.press("1", "BackSpace")
    replayed.passes(0.1)
    assert not (tmp_path / "phases.csv").exists()
    assert replayed.session.facts().marks is None


def test_g_goes_to_each_command_of_the_gripper_in_turn(tmp_path: Path) -> None:
    log = read_log(golden_log("outage"))
    ticks = [tick for tick in log.ticks if tick.arm is not None]
    told = [
        (tick.started_ns - log.header.started_ns) / NS_PER_S
        for before, tick in pairwise(ticks)
        if bool(before.arm.gripper_closed) != bool(tick.arm.gripper_closed)
    ]
    assert told
    replayed = Replayed(golden_log("outage"), tmp_path, speed=1e-9)
    for t_s in (*told, told[-1]):  # where there is no further one it stays
        replayed.press("g")
        replayed.passes(0.05)
        assert replayed.session.elapsed_s() == pytest.approx(t_s)
