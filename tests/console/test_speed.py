"""`doctor --speed`: what a session's log says of the machine, and how that is told."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

import pytest
from rich.console import Console

from tams_app.config import Config, load_config
from tams_app.console import speed
from tams_app.console.speed import Stretch
from tams_app.recording import SessionLog
from tams_app.records import CameraRates
from tams_app.runtime.machine_speed import MachineSpeed
from tests.synthetic_session import START_NS, Synthetic, tick

pytestmark = pytest.mark.untimed


def session(fps: float = 30.0) -> SessionLog:
    """Ten seconds of `fps` frames a second, of 30 that were asked for."""
    log = Synthetic(10.0).log()
    log.rates = [CameraRates(START_NS, fps, "", {}, {})]
    return log


def thinned(every: int) -> SessionLog:
    """A session in which one view misses one frame of `every`."""
    log = session()
    log.captured = [one for one in log.captured if one.view != "gs" or one.index % every]
    return log


def test_what_a_session_does_at_its_start_is_no_judgement() -> None:
    log = session()
    early_ns = START_NS + speed.WARM_UP_NS
    log.captured = [one for one in log.captured if one.capture_ns >= early_ns or one.index % 3]
    log.ticks = [tick(number, late_ns=2_000_000 * (number < 300)) for number in range(1200)]
    found = speed.stretch(log, 30)
    assert found.held
    assert found.given_fps == pytest.approx(30, rel=0.02)
    assert found.late == 0


def test_a_rate_is_held_as_long_as_a_session_s_ladder_would_keep_it() -> None:
    for share, held in ((0.01, True), (0.03, False)):
        log, every = session(), round(1 / share)
        log.ticks = [
            tick(number, late_ns=2_000_000 * (number % every == 0)) for number in range(1200)
        ]
        found = speed.stretch(log, 30)
        assert found.late == pytest.approx(share, rel=0.1)
        assert found.held is held
    assert speed.stretch(thinned(20), 30).held
    assert not speed.stretch(thinned(5), 30).held


def test_a_session_that_ended_at_once_holds_nothing() -> None:
    log = session()
    log.rates = []
    assert not speed.stretch(log, 30).held


def told(
    monkeypatch: pytest.MonkeyPatch,
    holds: Callable[[int], bool],
    display: bool = False,
    as_json: bool = False,
    start_fps: float = 30.0,
) -> tuple[int, str, list[tuple[bool, int]]]:
    """The exit code, what is printed and which sessions were run, each headless at a rate."""
    asked: list[tuple[bool, int]] = []

    def measured(_config: Config, headless: bool, fps: int) -> SessionLog:
        asked.append((headless, fps))
        return session()

    def judged(log: SessionLog, fps: float) -> Stretch:
        return Stretch(fps, fps if holds(int(fps)) else 0.5 * fps, 0.0, 33.3)

    monkeypatch.setattr(speed, "_session", measured)
    monkeypatch.setattr(speed, "stretch", judged)
    monkeypatch.setattr(speed, "has_display", lambda: display)
    monkeypatch.setattr(MachineSpeed, "starting_fps", lambda _self, _asked: start_fps)
    output = io.StringIO()
    settings: Any = load_config(None)
    code = speed.run_speed(settings, as_json, Console(file=output, width=200))
    return code, output.getvalue(), asked


def test_what_the_machine_holds_is_told_without_and_with_windows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code, text, asked = told(monkeypatch, lambda _fps: True, display=True)
    assert (code, asked) == (0, [(True, 30), (False, 30)])
    for title in ("Without windows", "With windows"):
        assert f"{title}: this machine holds 3 views at 30 frames a second." in text
    assert text.splitlines()[-1] == "Use: run_tams.py run"


def test_the_ladder_is_walked_down_to_a_rate_that_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text, asked = told(monkeypatch, lambda fps: fps <= 7, start_fps=20.0)
    assert (code, [fps for _, fps in asked]) == (0, [20, 15, 10, 7])
    assert text.splitlines()[-1] == "Use: run_tams.py run --headless --fps 7"


def test_the_ladder_is_walked_up_from_a_rate_that_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text, asked = told(monkeypatch, lambda fps: fps <= 15, start_fps=10.0)
    assert (code, [fps for _, fps in asked]) == (0, [10, 15, 20])
    assert "holds 3 views at 15 frames a second" in text


def test_a_machine_that_holds_nothing_is_a_failure_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code, text, asked = told(monkeypatch, lambda _fps: False)
    assert (code, [fps for _, fps in asked]) == (1, [30, 20, 15, 10, 7, 5])
    assert "3 views at no rate of the ladder" in text
    assert text.splitlines()[-1].startswith("Close other programs")


def test_a_program_reads_each_session_with_the_rates_that_were_tried(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text, _ = told(monkeypatch, lambda _fps: False, display=True, as_json=True)
    tree = json.loads(text)
    assert code == 1
    assert (tree["asked_fps"], tree["views"]) == (30, 3)
    assert [one["windows"] for one in tree["sessions"]] == [False, True]
    for one in tree["sessions"]:
        assert one["held_fps"] is None
        assert [rate["fps"] for rate in one["rates"]] == [30, 20, 15, 10, 7, 5]
        assert not any(rate["held"] for rate in one["rates"])
    assert tree["probe"]["starting_fps"] <= 30
    assert "Without windows: this machine holds" in capsys.readouterr().err


def test_where_too_few_frames_came_a_program_reads_no_number() -> None:
    log = session()
    log.captured = []
    assert speed.stretch(log, 30).tree()["interval_p95_ms"] is None


def test_without_a_display_windows_are_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text, _ = told(monkeypatch, lambda _fps: True)
    assert code == 0
    assert "With windows: not measured, there is no display." in text
