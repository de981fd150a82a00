"""The sender over real sockets: what it tells of each frame, drops, keyframes, a clean end."""

from __future__ import annotations

import os
import socket
import threading
import time
from dataclasses import replace
from itertools import pairwise

import pytest

from tams_app.config import VideoConfig
from tams_app.records import PacketKind
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_MS
from tams_app.video.core.pacer import Pacer
from tams_app.video.core.packets import identify, media_ssrc
from tests.faults.applications import until
from tests.video.lossy_link import LossyLink
from tests.video.scenes import frame
from tests.video.streams import PATIENT, Stream, stream

pytestmark = pytest.mark.waiting


def test_packets_carry_the_fixed_numbers_of_their_view_also_where_rtcp_came_before_them() -> None:
    link = LossyLink()
    with stream(link) as joined:
        for sequence in range(5):  # so that the receiver has something to report
            header = b"\x80\x60\0" + bytes([sequence]) + b"\0\0\0\1\0\0\0\7"
            link.bring(header + b"\x41" * 20)
        until(lambda: len(link.feedback) >= 3, "feedback")
        joined.carry(range(10))
        wire_bytes = joined.sender.wire_bytes
    assert wire_bytes == sum(len(datagram) + 28 for datagram in link.rtp)
    headers = [datagram[:12] for datagram in link.rtp]
    assert {header[1] & 0x7F for header in headers} == {96}
    assert {int.from_bytes(header[8:12], "big") for header in headers} == {
        media_ssrc(VideoConfig(), "eih")
    }
    sequence = [int.from_bytes(header[2:4], "big") for header in headers]
    assert sequence == list(range(len(headers)))
    assert max(len(datagram) for datagram in link.rtp) <= VideoConfig().mtu_bytes


def test_frames_overrun_in_front_of_the_encoder_cost_the_others_nothing() -> None:
    with stream() as joined:
        for index in range(60):
            joined.sender.push(frame(index, capture_ns=index))  # far faster than x264
        assert joined.wait_until(lambda: joined.shown_indices()[-1:] == [59])
        assert joined.sender.poll() == ""
    assert len(joined.encoded) < 60
    assert all(each.capture_ns == each.index for each in joined.encoded)


class NotedPacer(Pacer):
    """A pacer that keeps what it was asked and what it said: (asked, size, leaves)."""

    def __init__(self, capacity_kbps: float) -> None:
        super().__init__(capacity_kbps)
        self.told: list[tuple[int, int, int]] = []

    def reserve(self, now_ns: int, size_bytes: int) -> int:
        leaves_ns = super().reserve(now_ns, size_bytes)
        self.told.append((now_ns, size_bytes, leaves_ns))
        return leaves_ns


class PunctualClock(MonotonicClock):
    """After a sleep it says once that it is on time, however late the machine has woken it."""

    def __init__(self) -> None:
        self._woken = threading.local()  # frames are pushed in another thread

    def sleep_until_ns(self, deadline_ns: int) -> None:
        super().sleep_until_ns(deadline_ns)
        self._woken.ns = deadline_ns

    def now_ns(self) -> int:
        woken_ns, self._woken.ns = getattr(self._woken, "ns", None), None
        return super().now_ns() if woken_ns is None else woken_ns


@pytest.mark.parametrize("protected", [False, True])
def test_a_paced_frame_leaves_in_parts_and_arrives_as_it_was(
    protected: bool,
) -> None:
    link, pacer = LossyLink(), NotedPacer(2000.0)
    rule = replace(PATIENT, parity=protected)
    with stream(link, rule, kbps=1500.0, fps=30, pacer=pacer) as joined:
        if joined.parity is not None:
            joined.parity.groups = 1
        joined.sender._clock = PunctualClock()  # else a busy machine leaves frames unpaced
        joined.carry(range(30))
        sent_bytes = joined.sender.wire_bytes
    assert joined.exact
    packets = [identify(datagram) for datagram in link.rtp]
    media = [sequence for kind, sequence, _ in packets if kind is PacketKind.MEDIA]
    assert media == sorted(media)
    assert any(kind is PacketKind.PARITY for kind, _, _ in packets) is protected
    assert len(pacer.told) > 45  # two parts a frame, most of them
    assert sum(size for _, size, _ in pacer.told) == sent_bytes
    assert all(after[2] > before[2] for before, after in pairwise(pacer.told))


@pytest.mark.parametrize(("protected", "paced"), [(False, True), (True, True), (False, False)])
def test_what_each_stage_takes_is_known_until_the_packets_leave_and_when_they_came(
    protected: bool, paced: bool
) -> None:
    rule = replace(PATIENT, parity=protected)
    with stream(rule=rule, kbps=1500.0, fps=30, pacer=Pacer(2000.0) if paced else None) as joined:
        if joined.parity is not None:
            joined.parity.groups = 1
        joined.carry(range(10))
        taken = joined.sender.stages.ms
    assert list(taken) == ["camera", "to_encoder", "encoder", "sender"][: 3 + paced]
    assert all(ms > 0 for ms in taken.values())
    encoded_ns = {one.index: one.encoded_ns for one in joined.encoded}
    assert all(encoded_ns[one.index] < one.received_ns < one.shown_ns for one in joined.shown)


class LateClock(MonotonicClock):
    """Wakes 20 ms late, as a machine does that has too much to do."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        super().sleep_until_ns(deadline_ns + 20 * NS_PER_MS)


def test_where_its_thread_wakes_late_a_sender_does_not_pace_for_a_while() -> None:
    pacer = NotedPacer(2000.0)
    with stream(kbps=1500.0, fps=30, pacer=pacer) as joined:
        joined.sender._clock = LateClock()
        joined.carry(range(20))
    assert 0 < len(pacer.told) < 20  # parts of the first frames only


def test_closing_ends_all_threads_and_frees_all_ports() -> None:
    with stream() as joined:  # GStreamer starts some threads once for the whole process
        joined.push(range(3))
    before = _threads()
    with stream() as joined:
        joined.push(range(10))
        during = _threads()
    joined.sender.close()
    joined.receiver.close()
    deadline = time.monotonic() + 10
    while _threads() > before and time.monotonic() < deadline:
        time.sleep(0.02)  # GStreamer's pool lets idle threads go by itself
    assert during > before
    assert _threads() <= before
    unstarted = Stream(VideoConfig(), PATIENT, 1000.0)
    unstarted.sender.close()
    unstarted.receiver.close()
    for exits in (joined.exits, unstarted.exits):
        for port in (exits.rtp, exits.reports, exits.feedback):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
                again.bind(("127.0.0.1", port))


def _threads() -> int:
    return len(os.listdir("/proc/self/task"))
