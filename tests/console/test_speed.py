"""`doctor --speed`: what a session's log says of the machine, and how that is told."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest
from rich.console import Console

from tams_app.config import Config, load_config
from tams_app.console import speed
from tams_app.recording import SessionLog
from tams_app.records import CameraRates
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, tick

pytestmark = pytest.mark.untimed


def session(*steps: tuple[float, float]) -> SessionLog:
    """Ten seconds of 30 frames a second; `steps`: when which rate was asked for."""
    log = Synthetic(10.0).log()
    log.rates = [
        CameraRates(START_NS + round(t_s * NS_PER_S), fps, "stepped", {}, {}) for t_s, fps in steps
    ]
    return log


def test_each_rate_is_judged_by_the_time_in_which_it_was_asked_for() -> None:
    log = session((0.0, 30.0), (4.0, 15.0))
    log.captured = [
        one for one in log.captured if one.capture_ns < START_NS + 4 * NS_PER_S or one.index % 2
    ]
    first, second = speed.stretches(log)
    assert (first.fps, second.fps) == (30.0, 15.0)
    assert first.given_fps == pytest.approx(30, rel=0.02)
    assert second.given_fps == pytest.approx(15, rel=0.02)
    assert second.interval_p95_ms == pytest.approx(66.7, abs=0.1)
    assert first.held
    assert second.held


def test_a_rate_is_not_held_with_late_ticks_or_with_frames_that_did_not_come() -> None:
    log = session((0.0, 30.0))
    log.ticks = [tick(number, late_ns=2_000_000 * (number % 100 == 0)) for number in range(1200)]
    (late,) = speed.stretches(log)
    assert late.late == pytest.approx(0.01, rel=0.1)
    assert not late.held
    log = session((0.0, 30.0))
    log.captured = [one for one in log.captured if one.view != "gs" or one.index % 5]
    (thin,) = speed.stretches(log)
    assert not thin.held


def test_a_rate_that_was_left_soon_is_no_judgement() -> None:
    assert [one.fps for one in speed.stretches(session((0.0, 30.0), (2.5, 20.0)))] == [20.0]


def told(
    monkeypatch: pytest.MonkeyPatch, log: SessionLog, display: bool, as_json: bool = False
) -> tuple[int, str]:
    asked: list[bool] = []

    def measured(_config: Config, headless: bool) -> SessionLog:
        asked.append(headless)
        return log

    monkeypatch.setattr(speed, "_session", measured)
    monkeypatch.setattr(speed, "has_display", lambda: display)
    output = io.StringIO()
    settings: Any = load_config(None)
    code = speed.run_speed(settings, as_json, Console(file=output, width=200))
    assert asked == ([True, False] if display else [True])
    return code, output.getvalue()


def test_what_the_machine_holds_is_told_without_and_with_windows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code, text = told(monkeypatch, session((0.0, 30.0)), display=True)
    assert code == 0
    for title in ("Without windows", "With windows"):
        assert f"{title}: this machine holds 3 views × 30 frames a second" in text
    assert "control late 0.00 %" in text


def test_a_program_reads_each_session_with_the_rates_that_were_tried(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = session((0.0, 30.0))
    log.captured = [one for one in log.captured if one.view != "gs" or one.index % 5]
    code, text = told(monkeypatch, log, display=True, as_json=True)
    tree = json.loads(text)
    assert code == 1
    assert (tree["asked_fps"], tree["views"]) == (30, 3)
    assert [one["windows"] for one in tree["sessions"]] == [False, True]
    for one in tree["sessions"]:
        assert one["held_fps"] is None
        (rate,) = one["rates"]
        assert (rate["fps"], rate["held"]) == (30.0, False)
    assert tree["probe"]["starting_fps"] <= 30
    assert "Without windows: this machine holds" in capsys.readouterr().err


def test_where_too_few_frames_came_a_program_reads_no_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = session((0.0, 30.0))
    log.captured = []
    _, text = told(monkeypatch, log, display=False, as_json=True)
    assert "Infinity" not in text
    assert json.loads(text)["sessions"][0]["rates"][0]["interval_p95_ms"] is None


def test_without_a_display_windows_are_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text = told(monkeypatch, session((0.0, 30.0)), display=False)
    assert code == 0
    assert "With windows: not measured, there is no display." in text


def test_a_machine_that_holds_nothing_is_a_failure_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = session((0.0, 5.0))
    log.captured = [one for one in log.captured if one.index % 10 == 0]
    code, text = told(monkeypatch, log, display=False)
    assert code == 1
    assert "at no rate that was tried: 5 frames a second (given 3.0" in text
    assert "Close other programs" in text
