"""The summary as people see it."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from tams_app.console.report import summary_tables
from tams_app.recording import SessionLog
from tams_app.records import CameraRates, FrameQuality, Outcome, Phase, PhaseChange
from tams_app.summary import summarise
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, header

pytestmark = pytest.mark.untimed


def printed(log: SessionLog) -> str:
    output = io.StringIO()
    Console(file=output, width=110).print(summary_tables(summarise(log)))
    return output.getvalue()


def test_the_table_shows_the_numbers_of_the_summary() -> None:
    text = printed(Synthetic(5.0, accuracy=0.9).log())
    assert "tams on s2, 5.0 s: completed in 42.5 s, drops: 1, success (placed)" in text
    assert "120 Hz, 600 ticks, late 0.00 %" in text
    assert "stops: 1, longest 55 ms" in text
    assert "4500 of 6000 kbit/s, used 75 %" in text
    (row,) = (line.split() for line in text.splitlines() if line.strip().startswith("GT"))
    assert row[:5] == ["GT", "2000", "1800", "10.0", "%"]
    assert "30.0/30" in row
    assert "150/150" in row


def test_the_primary_views_quality_is_told_with_how_much_of_it_was_looked_at() -> None:
    log = Synthetic(1.0).log()
    log.phases = [PhaseChange(START_NS, Phase.REACH, "start")]
    scores = {"received": 0.912, "delivered": 0.87, "live": 0.5}
    log.quality = [
        FrameQuality("gt", one.index, one.capture_ns, None, None, False, None, **scores)
        for one in log.captured
        if one.view == "gt" and one.index % 2
    ]
    text = " ".join(printed(log).split())
    assert "Primary view SSIM received 0.912, delivered 0.870, live 0.500; 50 % compared" in text


def test_a_success_with_too_few_frames_is_not_told_without_them() -> None:
    log = Synthetic(5.0).log()
    log.captured = [one for one in log.captured if one.index % 2 == 0]
    log.rates = [
        CameraRates(START_NS, 30.0, "", {}, {}),
        CameraRates(START_NS + NS_PER_S, 15.0, "34 % of the frames were missed", {}, {}),
    ]
    (headline, *_) = summary_tables(summarise(log)).renderables
    verdict, sentence = str(headline).splitlines()
    assert verdict.endswith("success (placed)")
    assert sentence == (
        "Too few frames came, eih 15.0, gt 15.0, gs 15.0 of 30 a second: the cameras were stepped "
        "down, because 34 % of the frames were missed, and were asked for 15 at the end; close "
        "other programs or use a faster machine (`doctor --speed` tells what this one holds)."
    )


def test_a_row_of_a_view_fits_a_terminal_of_eighty_columns() -> None:
    log = Synthetic(40.0).log()
    log.shown = [one for one in log.shown if one.index % 60 < 30]
    output = io.StringIO()
    Console(file=output, width=80).print(summary_tables(summarise(log)))
    lines = output.getvalue().splitlines()
    assert [line.split()[0] for line in lines[-4:]] == ["View", "EIH", "GT", "GS"]


def test_a_failed_trial_says_so() -> None:
    log = Synthetic(1.0).log()
    log.outcome = Outcome(False, False, None, 3, "time is over")
    assert "not completed, drops: 3 (time is over)" in printed(log)


def test_what_was_not_measured_is_a_dash_and_no_error() -> None:
    text = printed(SessionLog(header(), START_NS))
    assert "no verdict on the task" in text
    assert "None" not in text
    assert "–" in text
