"""A sender and a receiver joined over loopback, and the frames a complete stream decodes to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from zlib import crc32

from tams_app.config import VideoConfig
from tams_app.records import DroppedFrame, EncodedFrame, PacketArrival, ShownFrame
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tams_app.video.core.codecs import bgr_of
from tams_app.video.core.pacer import FlightBound, Pacer
from tams_app.video.core.packets import media_ssrc, parity_ssrc
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.rtcp import ReceivedFeedback
from tams_app.video.core.sender import StreamSettings, Uplink
from tams_app.video.live.codecs import decoded
from tams_app.video.live.receiver import VideoReceiver
from tams_app.video.live.sender import VideoSender
from tams_app.video.live.view_codecs import ViewDecoder
from tests.video.lossy_link import LossyLink
from tests.video.scenes import HEIGHT, WIDTH, frame

PATIENT = RepairRule(rtx=True, latency_ms=400, pli_interval_ms=300.0)
UNREPAIRED = RepairRule(rtx=False, latency_ms=20, pli_interval_ms=300.0)
LOOK_S, EMPTY_LOOKS = 0.2, 4  # one may find nothing on a machine that stands still for a moment


class Stream:
    """What went through one sender and one receiver."""

    def __init__(
        self,
        config: VideoConfig,
        rule: RepairRule,
        kbps: float,
        feedback: bool = False,
        flight: FlightBound | None = None,
        pacer: Pacer | None = None,
    ) -> None:
        self.clock = MonotonicClock()
        self.encoded: list[EncodedFrame] = []
        self.dropped: list[DroppedFrame] = []
        self.shown: list[ShownFrame] = []
        self.received = ReceivedFeedback("eih", media_ssrc(config, "eih"))
        self._arrived = threading.Condition()
        self.parity = ViewParity(parity_ssrc(config, "eih"), feedback) if rule.parity else None
        parity = {"eih": self.parity} if self.parity else {}
        self.sender = VideoSender(
            StreamSettings("eih", config, rule.rtx, kbps, 80.0),
            Uplink({"eih": self.received}, feedback, parity, flight, pacer),
            self.clock,
            self.encoded.append,
        )
        self.receiver = VideoReceiver(
            "eih", config, rule, self.clock, self.sender.sent.find, self._note, feedback
        )
        self.exits = replace(self.receiver.ports, feedback=self.sender.feedback_port)
        self._pushed = 0
        self._period_s = 1.0 / config.fps
        self.capture_ns = self.clock.now_ns()

    def push(self, indices: range) -> None:
        """Push frames at the camera's pace, or slower where the encoder does not keep up.

        Their capture times are those of a camera that keeps its pace.
        """
        frames = [frame(index) for index in indices]
        due = time.monotonic()
        for each in frames:
            time.sleep(max(0.0, due - time.monotonic()))
            ready_ns = self.clock.now_ns()
            each = replace(each, capture_ns=self.capture_ns, ready_ns=ready_ns)
            if (dropped := self.sender.push(each)) is not None:
                self.dropped.append(dropped)
            self.capture_ns += round(self._period_s * NS_PER_S)
            self._pushed += 1
            self._wait_for_encoder()
            due = max(due + self._period_s, time.monotonic())
            assert self.sender.poll() == ""
            assert self.receiver.poll() == ""

    def carry(self, indices: range) -> None:
        """Push frames, and wait until all that were pushed so far have been shown."""
        self.push(indices)
        assert self.wait_until(lambda: len(self.shown) == self._pushed)

    @property
    def exact(self) -> bool:
        """Every frame that was encoded has been shown as it looks where nothing is lost."""
        return {one.index: checksum(one) for one in self.shown} == decoded_checksums(self.encoded)

    def wait_until(self, condition: Callable[[], bool], timeout_s: float = 20.0) -> bool:
        """Wait for a condition that another frame may bring about."""
        with self._arrived:
            return self._arrived.wait_for(condition, timeout_s)

    def arrivals(self, enough: Callable[[], float]) -> list[PacketArrival]:
        """What was told of packets, once it is `enough` or nothing more comes."""
        told: list[PacketArrival] = []
        deadline, empty = time.monotonic() + 20, 0
        while time.monotonic() < deadline and len(told) < enough() and empty < EMPTY_LOOKS:
            told += (more := self.received.take_arrivals())
            empty = 0 if more or not told else empty + 1
            time.sleep(LOOK_S)
        return told

    def shown_indices(self) -> list[int]:
        return [each.index for each in self.shown]

    def _wait_for_encoder(self) -> None:
        deadline = time.monotonic() + 20
        while len(self.encoded) + len(self.dropped) < self._pushed:
            assert time.monotonic() < deadline, "the encoder is stuck"
            time.sleep(0.001)

    def _note(self, shown: ShownFrame) -> None:
        with self._arrived:
            self.shown.append(shown)
            self._arrived.notify_all()


@contextmanager
def stream(
    link: LossyLink | None = None,
    rule: RepairRule = PATIENT,
    kbps: float = 1500.0,
    fps: int = 60,
    **more: Any,
) -> Iterator[Stream]:
    """`more`: as for `Stream`."""
    joined = Stream(VideoConfig(fps=fps), rule, kbps, **more)
    if link is not None:
        link.start(joined.exits)
    entrances = joined.exits if link is None else link.entrances
    joined.receiver.start(entrances)
    joined.sender.start(entrances)
    try:
        yield joined
    finally:
        joined.sender.close()
        joined.receiver.close()
        if link is not None:
            link.close()


def decoded_checksums(encoded: list[EncodedFrame]) -> dict[int, int]:
    """What each frame looks like (CRC of its BGR bytes) when nothing was lost."""
    index_of = {one.capture_ns: one.index for one in encoded}
    return {
        index_of[capture_ns]: crc32(bgr_of(planes, HEIGHT, WIDTH).tobytes())
        for capture_ns, planes in decoded(iter(encoded))
    }


def jitter_counts(decoder: ViewDecoder) -> dict[str, int]:
    """What the jitter buffer counts: packets lost for good, asked for again, and got so."""
    stats = decoder.jitterbuffer.get_property("stats")
    return {name: stats.get_value(name) for name in ("num-lost", "rtx-count", "rtx-success-count")}


def checksum(shown: ShownFrame) -> int:
    return crc32(shown.image.tobytes())
