"""Where a frame's time goes, on records whose answer is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tams_app.recording import FrameCaptured, FrameSent, FrameShown, SessionLog
from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.summary.stages import latency_stages
from tams_app.summary.tables import PacketTable
from tams_app.units import NS_PER_MS
from tams_app.video.core.stages import STAGES
from tests.synthetic_session import START_NS, header, rtp_timestamp

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
    found = latency_stages(log, "eih", PacketTable.of(log))["latency_stages_ms"]
    assert list(found) == list(STAGES)
    return [of["p50"] for of in found.values()]


def own(log: SessionLog) -> Any:
    return latency_stages(log, "eih", PacketTable.of(log))["own_latency_ms"]["p50"]


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
