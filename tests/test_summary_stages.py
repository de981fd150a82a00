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


def test_each_stage_ends_where_the_next_begins() -> None:
    assert medians(frame()) == [4, 1, 7, 3, 45, 3]


def test_all_but_the_network_is_the_latency_without_it() -> None:
    assert own(frame()) == SHOWN - (RECEIVED - ENTERED)
    assert own(frame(shown_ms=None)) is None


def test_a_resent_packet_is_time_of_the_network_and_not_of_the_sender() -> None:
    log = frame()
    log.packets[1] = packet(ENTERED, None, sequence=2)
    log.packets.append(packet(90, 130, sequence=2, kind=PacketKind.REPAIR))
    log.shown = [FrameShown("eih", 0, at(140), True, at(132))]
    assert medians(log) == [4, 1, 7, 3, 132 - ENTERED, 8]


def test_packets_that_carry_nothing_of_the_frame_count_for_no_stage() -> None:
    log = frame()
    log.packets.append(packet(20, 61, kind=PacketKind.PARITY))
    log.packets.append(packet(20, 61, view="gt"))
    assert medians(log) == [4, 1, 7, 3, 45, 3]


def test_of_a_frame_that_was_never_shown_the_sender_s_stages_are_known() -> None:
    assert medians(frame(shown_ms=None)) == [4, 1, 7, 3, None, None]


def test_without_an_emulated_network_what_lies_between_two_clocks_is_not_told() -> None:
    log = frame()
    log.packets = []
    assert medians(log) == [4, 1, 7, None, None, SHOWN - RECEIVED]


def test_the_operator_s_side_alone_knows_of_its_decoder() -> None:
    log = frame()
    log.packets, log.sent = [], []
    assert medians(log) == [None, None, None, None, None, SHOWN - RECEIVED]


def test_a_log_that_does_not_say_when_the_encoder_began_tells_of_no_encoder() -> None:
    log = frame()
    log.sent = [replace(log.sent[0], pushed_ns=0)]
    assert medians(log) == [4, None, None, 3, 45, 3]
    assert own(log) is None


def test_a_log_that_does_not_say_when_the_picture_was_made_tells_of_no_camera() -> None:
    log = frame()
    log.sent = [replace(log.sent[0], ready_ns=0)]
    assert medians(log) == [None, None, 7, 3, 45, 3]


def test_a_log_that_does_not_say_when_a_frame_was_received_does_not_blame_the_decoder() -> None:
    log = frame()
    log.shown = [replace(log.shown[0], received_ns=0)]
    assert medians(log) == [4, 1, 7, 3, None, None]
