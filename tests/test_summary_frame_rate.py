"""Frames a second in summary.json, and the sentence where too few were given."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tams_app.recording import SessionLog, read_log
from tams_app.records import CameraRates
from tams_app.summary import summarise
from tams_app.summary.frame_rate import shortfall
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, VIEWS, Synthetic, header

pytestmark = pytest.mark.untimed

DATA = Path(__file__).parent / "data"


def thinned(step: int, **changes: Any) -> SessionLog:
    """Five seconds of every `step`-th frame of 30 a second."""
    log = Synthetic(5.0).log()
    log.captured = [one for one in log.captured if one.index % step == 0]
    log.header = header(**changes)
    return log


def shortfall_of(log: SessionLog) -> str:
    sentence = summarise(log)["rates"]["shortfall"]
    assert isinstance(sentence, str)
    return sentence


def test_frames_and_their_intervals_are_those_of_the_captures() -> None:
    summary = summarise(thinned(2))
    for view in VIEWS:
        assert summary["views"][view]["fps"]["asked"] == 30
        assert summary["views"][view]["fps"]["given"] == pytest.approx(15, rel=0.01)
        assert summary["views"][view]["frame_interval_ms"]["p95"] == pytest.approx(66.67, abs=0.01)


@pytest.mark.parametrize(
    ("kept", "is_told"),
    [
        (lambda one: True, False),
        (lambda one: one.view != "gs" or one.index % 2, True),  # one view is enough
        (lambda one: one.index % 6, False),  # so are four fifths of what was asked for
    ],
)
def test_too_few_frames_of_any_view_are_told(kept: Callable[[Any], bool], is_told: bool) -> None:
    log = Synthetic(5.0).log()
    log.captured = list(filter(kept, log.captured))
    assert (summarise(log)["rates"]["shortfall"] is not None) == is_told


def test_cameras_that_give_too_few_are_told_from_an_application_that_takes_too_few() -> None:
    real = {"rig": {"enabled": False}}
    assert "The cameras delivered no more, as many do in dim light: add light" in shortfall_of(
        thinned(2, config=real)
    )
    log = thinned(2, config=real)
    log.rates = [CameraRates(START_NS, {}, dict.fromkeys(VIEWS, 14.0))]
    assert "The application missed the others: close other programs" in shortfall_of(log)
    assert "The machine rendered no more" in shortfall_of(
        thinned(2, config={"rig": {"enabled": True}})
    )


def test_damaged_frames_are_counted_by_view_and_are_the_reason_where_too_few_came() -> None:
    log = thinned(2, config={"rig": {"enabled": False}})
    log.rates = [
        CameraRates(START_NS + second * NS_PER_S, {}, {}, {"eih": 0, "gs": 15})
        for second in range(3)
    ]
    views = summarise(log)["views"]
    assert [views[view]["frames_damaged_at_camera"] for view in ("eih", "gs")] == [0, 45]
    assert "Frames arrived damaged (45 of gs) and were left out: check the" in shortfall_of(log)


def test_what_to_ask_for_instead_is_a_rate_that_run_takes() -> None:
    assert "--fps 14" in shortfall(30, {"eih": 14.9, "gt": 20.0}, {}, simulated=False)
    assert shortfall(30, {"eih": 0.0}, {}, simulated=False).endswith("--fps 5.")


@pytest.mark.parametrize("simulated", [False, True])
def test_nobody_is_told_to_ask_for_less_with_the_rate_that_they_asked_for(simulated: bool) -> None:
    told = shortfall(5, {"eih": 3.9, "gt": 4.9}, {}, simulated=simulated)
    assert "--fps" not in told
    assert told.endswith("close other programs." if simulated else "shorten their exposure.")


def test_a_log_from_before_has_its_rates_as_far_as_its_frames_tell() -> None:
    log = read_log(DATA / "virtual-0.1.mcap")
    summary = summarise(log)
    for entry in summary["views"].values():
        assert entry["fps"]["asked"] == log.header.fps
        assert entry["fps"]["given"] > 0
