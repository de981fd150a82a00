"""Comparing two checkouts: what runs, what is kept, and how it ends."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import cycle

import pytest

from benchmarks import paired
from benchmarks.checkouts import Checkout, SessionCost, Setting, session_measures
from benchmarks.processor_time import Profile
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.summary.summarise import summarise
from tests.synthetic_session import START_NS, Synthetic

pytestmark = pytest.mark.untimed

PROFILE = Profile(
    start_ns=START_NS,
    end_ns=START_NS + 2_000_000_000,
    application_s=1.9,
    threads={"control": 0.6, "pictures:src": 0.3, "jitterbuffer:sr": 0.2},
    helpers={"rig": 0.5, "renderer": 1.8, "operator": 0.1},
    others_s=0.2,
)


@pytest.fixture
def figures():
    log = Synthetic(6.0).log()
    armings = cycle(("engaged", "ready"))
    log.ticks = [replace(tick, arming=next(armings)) for tick in log.ticks]
    return session_measures(PROFILE, log, summarise(log))


def test_figures_count_the_ticks_and_frames_of_the_time_that_was_measured(figures) -> None:
    assert figures["control_ms_per_tick"] == pytest.approx(600 / 241)
    assert figures["fps_given"] == pytest.approx(30)
    assert figures["beyond_share"] == pytest.approx(1.4 / 2)
    assert figures["beyond_ms_per_frame"] == pytest.approx(1400 / 180)
    assert figures["beyond_with_operator_share"] == pytest.approx(1.5 / 2)
    assert figures["rig_share"] == pytest.approx(0.25)
    assert figures["set_ms"] == pytest.approx(1800 / 60)
    assert figures["engaged_share"] == pytest.approx(0.5, abs=0.01)
    assert figures["others_share"] == pytest.approx(0.1)
    assert figures["latency_p50_ms"] == pytest.approx(60)


@pytest.fixture
def compare(monkeypatch, tmp_path, figures):
    """`main` with runs that take no time; `session` is called with checkout and setting."""

    def run(session=lambda *_: SessionCost(PROFILE, figures)):
        monkeypatch.setattr(paired, "run_session", session)
        trial = {"virtual_cpu_s_per_s": 2.0, "virtual_s": 20.0}
        monkeypatch.setattr(paired, "run_trial", lambda *_: trial)
        path = tmp_path / "paired.json"
        arguments = ["--against", str(PROJECT_DIRECTORY), "--json", str(path), "--seed", "4"]
        code = paired.main(arguments)
        return code, json.loads(path.read_text(encoding="utf-8"))

    return run


def test_three_pairs_of_sessions_and_trials_give_every_ratio(compare, tmp_path) -> None:
    code, found = compare()
    assert code == 0
    assert found["failures"] == []
    assert len(found["runs"]) == 12
    assert {len(row["ratios"]) for row in found["rows"] if row["target"]} == {3}
    assert [row["verdict"] for row in found["rows"] if row["target"]] == ["missed"] * 5
    assert "virtual second" in (tmp_path / "paired.md").read_text(encoding="utf-8")
    assert found["profiles"][0]["application"]["control"] == 0.3


def test_both_sides_of_a_pair_have_its_seed(compare, figures) -> None:
    seeds = []

    def session(_: Checkout, setting: Setting) -> SessionCost:
        seeds.append(setting.seed)
        return SessionCost(PROFILE, figures)

    compare(session)
    assert seeds == [4, 4, 5, 5, 6, 6]


def test_a_session_that_fails_is_told_and_the_others_count(compare, figures, capsys) -> None:
    sessions = iter(range(6))

    def session(*_) -> SessionCost:
        if next(sessions) == 1:
            raise RuntimeError("exit code 1: no arm answers")
        return SessionCost(PROFILE, figures)

    code, found = compare(session)
    assert code == 1
    assert found["failures"] == [
        "pair 1 of 3, after: session: exit code 1: no arm answers",
    ]
    (row,) = [row for row in found["rows"] if row["key"] == "control_ms_per_tick"]
    assert len(row["ratios"]) == 2
    assert "no arm answers" in capsys.readouterr().out


def test_ctrl_c_keeps_what_there_is(compare, figures) -> None:
    sessions = iter(range(6))

    def session(*_) -> SessionCost:
        if next(sessions) == 3:
            raise KeyboardInterrupt
        return SessionCost(PROFILE, figures)

    code, found = compare(session)
    assert code == 130
    assert len(found["runs"]) == 5
    assert {len(row["ratios"]) for row in found["rows"] if row["target"]} == {1}


def test_a_directory_without_tams_is_refused(tmp_path, capsys) -> None:
    assert paired.main(["--against", str(tmp_path)]) == 2
    assert "no checkout of TAMS" in capsys.readouterr().out
