"""The summary as people see it."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import pytest

from tams_app.console.summary_tables import summary_tables
from tams_app.printing import Console
from tams_app.recording import SessionLog
from tams_app.records import CameraRates, Episode, FrameQuality, Phase, PhaseChange, StopRecord
from tams_app.summary import summarise
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, header

pytestmark = pytest.mark.untimed


def frozen() -> SessionLog:
    """Of a session in which each view stood still every other second."""
    log = Synthetic(40.0).log()
    log.shown = [one for one in log.shown if one.index % 60 < 30]
    return log


@pytest.fixture(scope="module")
def frozen_summary() -> dict[str, Any]:
    return summarise(frozen())


def shown(summary: dict[str, Any], width: int) -> str:
    output = io.StringIO()
    Console(file=output, width=width).print(summary_tables(summary))
    return output.getvalue()


def printed(log: SessionLog, width: int = 110) -> str:
    return shown(summarise(log), width)


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
    at_task = {"task_received": 0.8, "task_delivered": 0.7, "task_live": 0.4}
    log.quality = [replace(one, **at_task) for one in log.quality]
    text = " ".join(printed(log).split())
    told = "live 0.500; at the task received 0.800, delivered 0.700, live 0.400; 50 % compared"
    assert told in text


def test_a_success_with_too_few_frames_is_not_told_without_them() -> None:
    log = Synthetic(5.0).log()
    log.captured = [one for one in log.captured if one.index % 2 == 0]
    log.rates = [CameraRates(START_NS, {}, dict.fromkeys(("eih", "gt", "gs"), 15.0))]
    (headline, *_) = summary_tables(summarise(log)).renderables
    verdict, sentence = str(headline).splitlines()
    assert verdict.endswith("success (placed)")
    assert sentence == (
        "Too few frames: eih 15.0, gt 15.0, gs 15.0 per second of 30. The application missed the "
        "others: close other programs, or lower the rate with --fps 15."
    )


def test_a_row_of_a_view_fits_a_terminal_of_eighty_columns(frozen_summary: dict[str, Any]) -> None:
    lines = shown(frozen_summary, 80).splitlines()
    assert [line.split()[0] for line in lines[-4:]] == ["View", "EIH", "GT", "GS"]


@pytest.mark.parametrize("width", [30, 42, 60])
def test_on_a_narrow_terminal_each_views_figures_are_a_sentence_of_whole_words(
    frozen_summary: dict[str, Any], width: int
) -> None:
    lines = [line.rstrip() for line in shown(frozen_summary, width).splitlines()]
    assert max(len(line) for line in lines) <= width
    assert not any("…" in line for line in lines), "nothing is cut off"
    assert not any(line.startswith("View") for line in lines)
    first = next(number for number, line in enumerate(lines) if line.startswith("EIH "))
    assert " ".join(" ".join(lines[first:]).split()) == " ".join(
        f"{view} target {kbps} kbit/s, sent {kbps} kbit/s, error 0.0 %, fps 30.0/30, "
        "shown 600/1200, p50 60 ms, p95 60 ms, freezes 20 (20.6 s), SSIM –"
        for view, kbps in (("EIH", 1000), ("GT", 2000), ("GS", 2000))
    )


def test_no_figure_is_cut_on_terminals_from_narrow_to_wide(frozen_summary: dict[str, Any]) -> None:
    for width in range(42, 110):
        words = shown(frozen_summary, width).replace(",", " ").split()
        assert [words.count(figure) for figure in ("30.0/30", "600/1200", "s)")] == [3, 3, 3], width


def stop(reason: str, at_s: float, rest_ms: int | None) -> StopRecord:
    seen_ns = START_NS + round(at_s * NS_PER_S)
    return StopRecord(reason, seen_ns, None if rest_ms is None else seen_ns + rest_ms * NS_PER_MS)


def test_stops_are_named_with_their_time_reason_and_how_long_the_arm_took_to_rest() -> None:
    log = Synthetic(5.0).log()
    log.stops = [
        stop("stale video", 2.04, 81),
        stop("arm error: C31 (servo [x])", 31.5, None),
    ]
    first, second = (line.strip() for line in printed(log, 80).splitlines() if "rest a" in line)
    assert first.split(maxsplit=1) == ["Stops", "2.0 s stale video, at rest after 81 ms"]
    assert second == ("31.5 s arm error: C31 (servo [x]), not at rest at the end")


def test_of_many_stops_five_are_named_and_no_line_is_longer_than_eighty_columns() -> None:
    log = Synthetic(5.0).log()
    log.stops = [stop("guard stopped the arm", 1000.0 + number, 100) for number in range(7)]
    lines = printed(log, 80).splitlines()
    assert sum("guard stopped the arm" in line for line in lines) == 5
    assert [line.split() for line in lines if "…" in line] == [["…", "and", "2", "more"]]
    assert "stops: 7, longest 100 ms" in " ".join(" ".join(lines).split())
    assert max(len(line.rstrip()) for line in lines) <= 80


def test_episodes_are_listed_with_what_has_become_of_them() -> None:
    log = Synthetic(20.0).log()
    assert "Episodes" not in printed(log)
    began_ns = log.header.started_ns

    def episode(number: int, begin_s: int, kept: bool, success: bool | None) -> Episode:
        start_ns, end_ns = (began_ns + at_s * NS_PER_S for at_s in (begin_s, begin_s + 3))
        return Episode(end_ns, number, start_ns, end_ns, kept, success)

    log.episodes = [
        episode(1, 2, True, None),
        episode(2, 7, True, None),
        episode(2, 7, False, None),
    ]
    log.episodes.append(episode(3, 12, True, False))
    lines = [line.strip() for line in printed(log, 80).splitlines() if "s long" in line]
    assert [" ".join(line.split()) for line in lines] == [
        "Episodes 1 at 2.0 s, 3.0 s long: kept",
        "2 at 7.0 s, 3.0 s long: discarded",
        "3 at 12.0 s, 3.0 s long: kept, failure",
    ]
    assert ": 2 episodes kept, 1 discarded" in printed(log)
    assert "completed" not in printed(log)  # which is of one trial


def test_a_session_without_a_stop_or_a_freeze_has_no_line_for_them() -> None:
    log = Synthetic(5.0).log()
    log.stops = []
    text = printed(log)
    assert "Stops" not in text
    assert "Freezes" not in text


def test_a_view_that_froze_is_named_with_how_often_and_the_longest() -> None:
    log = Synthetic(10.0).log()
    log.shown = [
        one
        for one in log.shown
        if one.view != "gt" or not (60 <= one.index < 90 or 150 <= one.index < 225)
    ]
    (line,) = (line for line in printed(log, 80).splitlines() if line.startswith("Freezes"))
    assert line.split(maxsplit=1)[1].strip() == "GT 2, longest 2.5 s"


def test_what_was_not_measured_is_a_dash_and_no_error() -> None:
    text = printed(SessionLog(header(), START_NS))
    assert "no verdict on the task" in text
    assert "None" not in text
    assert "–" in text
