"""The entry of a view in summary.json: its frames, where their time goes, and what lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from tams_app.recording import FrameCaptured, FrameSent, FrameShown, SessionLog
from tams_app.records import CameraRates, PacketFate, PacketKind, PacketRecord
from tams_app.summary import summarise
from tams_app.summary.tables import LogTables
from tams_app.summary.views import latency_stages, shortfall
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.stages import STAGES
from tests.synthetic_session import START_NS, VIEWS, Synthetic, header, rtp_timestamp

pytestmark = pytest.mark.untimed

# Of a frame that is captured at 0: when each of its stages ends [ms].
READY, PUSHED, ENCODED, ENTERED, RECEIVED, SHOWN = 4, 5, 12, 15, 60, 63


def at(ms: float) -> int:
    return START_NS + round(ms * NS_PER_MS)


def packet(entered_ms: float, delivered_ms: float | None, **changes: Any) -> PacketRecord:
    one = PacketRecord(
        "eih",
        PacketKind.MEDIA,
        1,
        1000,
        at(entered_ms),
        at(entered_ms),
        0 if delivered_ms is None else at(delivered_ms),
        PacketFate.LOST if delivered_ms is None else PacketFate.DELIVERED,
        rtp_timestamp(0),
    )
    return replace(one, **changes)


def frame(shown_ms: float | None = SHOWN) -> SessionLog:
    """A log of one frame, whose packets entered 2 ms apart."""
    log = SessionLog(header(), at(1000))
    log.captured = [FrameCaptured("eih", 0, at(0))]
    log.sent = [FrameSent("eih", 0, at(0), at(ENCODED), True, 1900, at(PUSHED), 0, at(READY))]
    log.shown = [] if shown_ms is None else [FrameShown("eih", 0, at(shown_ms), True, at(RECEIVED))]
    log.packets = [packet(ENTERED - 2, 50), packet(ENTERED, 59, sequence=2)]
    return log


def medians(log: SessionLog) -> list[float | None]:
    found = latency_stages(LogTables(log), "eih")["latency_stages_ms"]
    assert list(found) == list(STAGES)
    return [of["p50"] for of in found.values()]


def own(log: SessionLog) -> Any:
    return latency_stages(LogTables(log), "eih")["own_latency_ms"]["p50"]


def without(what: str, **changes: Any) -> SessionLog:
    """The log of one frame whose record in `what` has these changes."""
    log = frame()
    setattr(log, what, [replace(one, **changes) for one in getattr(log, what)])
    return log


RESENT = replace(
    frame(),
    packets=[
        packet(ENTERED - 2, 50),
        packet(ENTERED, None, sequence=2),
        packet(90, 130, sequence=2, kind=PacketKind.REPAIR),
    ],
    shown=[FrameShown("eih", 0, at(140), True, at(132))],
)
OTHERS = [packet(20, 61, kind=PacketKind.PARITY), packet(20, 61, view="gt")]


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        pytest.param(frame(), [4, 1, 7, 3, 45, 3], id="each stage ends where the next begins"),
        pytest.param(RESENT, [4, 1, 7, 3, 132 - ENTERED, 8], id="a resend is the network's time"),
        pytest.param(
            replace(frame(), packets=frame().packets + OTHERS),
            [4, 1, 7, 3, 45, 3],
            id="packets that carry nothing of the frame count for no stage",
        ),
        pytest.param(frame(shown_ms=None), [4, 1, 7, 3, None, None], id="never shown"),
        pytest.param(
            replace(frame(), packets=[]),
            [4, 1, 7, None, None, SHOWN - RECEIVED],
            id="no emulated network: two clocks",
        ),
        pytest.param(
            replace(frame(), packets=[], sent=[]),
            [None, None, None, None, None, SHOWN - RECEIVED],
            id="the operator's side alone",
        ),
        pytest.param(without("sent", pushed_ns=0), [4, None, None, 3, 45, 3], id="no encoder"),
        pytest.param(without("sent", ready_ns=0), [None, None, 7, 3, 45, 3], id="no camera"),
        pytest.param(
            without("shown", received_ns=0), [4, 1, 7, 3, None, None], id="no jitter buffer"
        ),
    ],
)
def test_each_stage_is_told_as_far_as_the_log_tells_its_two_ends(
    log: SessionLog, expected: list[float | None]
) -> None:
    assert medians(log) == expected


def test_all_but_the_network_is_the_latency_without_it() -> None:
    assert own(frame()) == SHOWN - (RECEIVED - ENTERED)
    assert own(frame(shown_ms=None)) is None
    assert own(without("sent", pushed_ns=0)) is None


def thinned(step: int, **changes: Any) -> SessionLog:
    """Five seconds of every `step`-th frame of 30 a second."""
    log = Synthetic(5.0).log()
    log.captured = [one for one in log.captured if one.index % step == 0]
    log.header = header(**changes)
    return log


def shortfall_of(log: SessionLog) -> Any:
    return summarise(log)["rates"]["shortfall"]


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
