"""What the page's receiver sends is understood by the real sender, GStreamer's session in it."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from tams_app.config import VideoConfig
from tams_app.records import EncodedFrame
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tams_app.video.core.packets import media_ssrc
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.rtcp import ReceivedFeedback
from tams_app.video.core.sender import StreamSettings, Uplink
from tams_app.video.live.sender import VideoSender
from tams_app.video.live.udp import ViewPorts
from tests.faults.applications import until
from tests.page.packet_logs import page_rule
from tests.video.scenes import frame
from tests.video.streams import PATIENT, UNREPAIRED

pytestmark = pytest.mark.waiting

HERE = Path(__file__).parent
VIEW, HOST, FPS = "eih", "127.0.0.1", 30


class Stream:
    """A real sender, and what the page's receiver makes of its packets in a process of its own."""

    def __init__(self, rule: RepairRule, feedback: bool, lose_each: int) -> None:
        config = VideoConfig(fps=FPS)
        self.encoded: list[EncodedFrame] = []
        self.units: list[dict[str, Any]] = []
        self.received = ReceivedFeedback(VIEW, media_ssrc(config, VIEW))
        self.sender = VideoSender(
            StreamSettings(VIEW, config, rule.rtx, 1500.0, 80.0),
            Uplink({VIEW: self.received}, feedback),
            MonotonicClock(),
            self.encoded.append,
        )
        options = {
            "rule": page_rule(rule),
            "feedback": feedback,
            "senderPort": self.sender.feedback_port,
            "loseEach": lose_each,
        }
        self.receiver = subprocess.Popen(
            ["node", "live.js", json.dumps(options)],
            cwd=HERE,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        port = int(self._lines.readline())
        self._reader = Thread(target=self._read)
        self._reader.start()
        self.sender.start(ViewPorts(HOST, port, port, 0))

    @property
    def _lines(self) -> Any:
        assert self.receiver.stdout is not None
        return self.receiver.stdout

    def push(self, indices: range) -> None:
        """At the camera's pace, or slower."""
        for index in indices:
            now_ns = time.monotonic_ns()
            self.sender.push(replace(frame(index), capture_ns=now_ns, ready_ns=now_ns))
            time.sleep(1 / FPS)
            assert self.sender.poll() == ""

    @property
    def whole(self) -> set[int]:
        return {unit["timestamp"] for unit in self.units if unit["isWhole"]}

    def close(self) -> None:
        self.sender.close()
        assert self.receiver.stdin is not None
        self.receiver.stdin.close()
        assert self.receiver.wait(20) == 0
        self._reader.join()
        self._lines.close()

    def _read(self) -> None:
        self.units.extend(map(json.loads, self._lines))


@contextmanager
def stream(rule: RepairRule, feedback: bool, lose_each: int) -> Iterator[Stream]:
    joined = Stream(rule, feedback, lose_each)
    try:
        yield joined
    finally:
        joined.close()


def test_what_is_lost_is_resent_and_each_packets_fate_is_told() -> None:
    with stream(PATIENT, feedback=True, lose_each=23) as joined:
        joined.push(range(90))
        sent = {one.rtp_timestamp for one in joined.encoded[:-2]}  # of what follows the gap shows
        until(lambda: joined.whole >= sent, "all frames, whole")
        told = joined.received.take_arrivals()
    assert len(told) > 200
    lost = sum(one.arrived_ns is None for one in told)
    assert lost == pytest.approx(len(told) / 23, abs=2)
    transits = [one.arrived_ns - one.sent_ns for one in told if one.arrived_ns is not None]
    assert max(transits) - min(transits) < 5 * NS_PER_S


def test_a_keyframe_is_sent_when_one_is_asked_for_and_reports_tell_losses_and_round_trip() -> None:
    with stream(UNREPAIRED, feedback=False, lose_each=67) as joined:
        joined.push(range(60))
        reception, first = None, 60
        while reception is None or not reception.fraction_lost or reception.round_trip_ns is None:
            assert first < 1200, "no report of a loss"
            joined.push(range(first, first := first + 10))
            reception = joined.received.take_reception() or reception
    assert sum(one.keyframe for one in joined.encoded) > 1
    broken = [place for place, one in enumerate(joined.units) if not one["isWhole"]]
    again = [one for one in joined.units[broken[0] :] if one["isWhole"]]
    assert again
    assert again[0]["isKeyframe"]
    assert 0 <= reception.round_trip_ns < 2 * NS_PER_S
