"""A view's receiver without pipeline, socket and clock: which frame is which, and which are whole.

A frame is whole as it was encoded, every packet of its chain here. Where one is not, a keyframe is
asked for. Live and in virtual time the same object decides.
"""

from __future__ import annotations

from collections import deque
from contextlib import AbstractContextManager
from dataclasses import dataclass

from tams_app.errors import TamsError
from tams_app.records import Image, ShownFrame
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import Identify, RtpTimes, SentFrame
from tams_app.video.core.rate_control import FrameIntervals
from tams_app.video.core.repair import RepairRule

_RTP_SEQUENCE = slice(2, 4)  # of the RTP header (RFC 3550)
_RTP_TIMESTAMP = slice(4, 8)
_WAIT_TOLERANCE_MS = 10
_DECODING = 64  # frames: more than any decoder keeps
_LENGTH_BYTES = 4  # before each NAL unit, as the depayloader puts them together (`avc`)
_TYPE, _IDR = 0x1F, 5


@dataclass(frozen=True, slots=True)
class AccessUnitVerdict:
    """What is to be done when an access unit has come.

    shift_ns: to its PTS and, from now on, to the jitter buffer's. wait_ms: the jitter buffer's
    latency; None: as it is. asks_keyframe: one is to be requested now.
    """

    shift_ns: int
    wait_ms: int | None
    asks_keyframe: bool


class Receiver:
    """Judges the access units of one view, and identifies its decoded frames.

    `first_packet`, `request` and `access_unit` in the depayloader's thread, `identified` and
    `shown` in the decoder's. The `lock` guards the rate limit of keyframe requests alone.
    """

    def __init__(
        self,
        view: str,
        fps: int,
        rule: RepairRule,
        identify: Identify,
        lock: AbstractContextManager[object],
    ) -> None:
        self._view = view
        self._rule = rule
        self._identify = identify
        self._times: RtpTimes | None = None
        self._intervals = FrameIntervals(NS_PER_S // fps)
        self._wait_ms = rule.latency_ms
        self._requests = KeyframeRequests(rule.pli_interval_ms)
        self._requests_lock = lock
        self._start_request_is_idle = False
        self._chain = WholeChain()
        self._whole: deque[int] = deque(maxlen=_DECODING)  # RTP timestamps of whole frames
        # by RTP timestamp, when the jitter buffer had handed out the last packet [ns]
        self._received: deque[tuple[int, int]] = deque(maxlen=_DECODING)

    def first_packet(self, pts_ns: int, header: bytes) -> None:
        """Anchor the frame identity at the first packet that leaves the jitter buffer."""
        self._times = RtpTimes(pts_ns, int.from_bytes(header[_RTP_TIMESTAMP], "big"))
        # the depayloader asks for a keyframe at every start; packet 0 begins with one
        self._start_request_is_idle = header[_RTP_SEQUENCE] == b"\0\0"

    def request(self, now_ns: int, timestamp: int) -> bool:
        """The depayloader asks for a keyframe; True if the request may leave now.

        It does so for each gap, when the first packet after it has come: that with `timestamp`.
        """
        if self._start_request_is_idle:
            self._start_request_is_idle = False
            return False
        self._chain.gap(timestamp)
        if not self._rule.pli:
            return False
        with self._requests_lock:
            return self._requests.request(now_ns)

    def access_unit(
        self, now_ns: int, pts_ns: int, timestamp: int, has_idr: bool, has_end: bool
    ) -> AccessUnitVerdict:
        """Judge an access unit. `has_end`: it ends with the packet of this `timestamp`."""
        self._received.append((timestamp, now_ns))
        shift_ns, wait_ms = 0, None
        if has_end and self._times is not None:
            shift_ns = self._times.follow(pts_ns, timestamp)
            wait_ms = self._wait_for_resends(self._times.followed_ns)
        if shift_ns:
            # where about 65,536 packets or a multiple were lost, their numbers show no gap
            self._chain.gap(timestamp)
        if self._chain.access_unit(timestamp, has_idr, has_end):
            self._whole.append(timestamp)
        return AccessUnitVerdict(shift_ns, wait_ms, self._asks_keyframe(now_ns))

    def identified(self, pts_ns: int) -> tuple[int, SentFrame] | None:
        """The RTP timestamp of a decoded frame, and its capture.

        None where that is not known: a frame of unknown age is not to be steered by.
        """
        if self._times is None:
            raise TamsError("a frame came out before a packet went in")
        timestamp = self._times.timestamp(pts_ns)
        sent = self._identify(timestamp)
        return None if sent is None else (timestamp, sent)

    def shown(self, now_ns: int, timestamp: int, sent: SentFrame, image: Image) -> ShownFrame:
        """The record of a decoded frame."""
        whole = timestamp in self._whole
        received_ns = next((ns for one, ns in reversed(self._received) if one == timestamp), 0)
        return ShownFrame(
            self._view, sent.index, now_ns, image, sent.capture_ns, whole, received_ns
        )

    def _wait_for_resends(self, followed_ns: int) -> int | None:
        wait_ms = self._rule.wait_ms(self._intervals.step(followed_ns).usual_ns)
        if abs(wait_ms - self._wait_ms) <= _WAIT_TOLERANCE_MS:
            return None
        self._wait_ms = wait_ms
        return wait_ms

    def _asks_keyframe(self, now_ns: int) -> bool:
        """While decoding is broken, after each access unit."""
        if not self._rule.pli:
            return False
        with self._requests_lock:
            self._requests.chain(self._chain.unbroken)
            return self._requests.due(now_ns)


class KeyframeRequests:
    """Rate limit of keyframe requests (PLI): one per interval; an early one waits for its turn.

    A whole chain (`WholeChain`) answers every request before it. A PLI that stays unanswered for
    two intervals was lost itself and is sent again.
    """

    def __init__(self, interval_ms: float) -> None:
        self._interval_ns = round(interval_ms * NS_PER_MS)
        self._last_ns: int | None = None
        self._unanswered = False
        self._waiting = False  # a loss later than the last PLI

    def request(self, now_ns: int) -> bool:
        """A loss was seen: True if the PLI may leave now, else it waits for `due`."""
        self._unanswered = self._waiting = True
        return self.due(now_ns)

    def due(self, now_ns: int) -> bool:
        """True, once, when a waiting or unanswered PLI must leave now."""
        if not self._unanswered:
            return False
        wait_ns = self._interval_ns if self._waiting else 2 * self._interval_ns
        if self._last_ns is not None and now_ns - self._last_ns < wait_ns:
            return False
        self._waiting = False
        self._last_ns = now_ns
        return True

    def chain(self, unbroken: bool) -> None:
        """An access unit came: whether it is whole; where it is not, a keyframe is needed."""
        self._unanswered = not unbroken
        self._waiting = self._waiting and not unbroken


class WholeChain:
    """Judges the access units of one view, in the order of decoding: whether a frame is whole.

    A frame is predicted from the frames before it, back to the last keyframe: its chain. A packet
    that is missing damages its frame and all that follow, up to a keyframe of which all packets
    are here. Decoders do not report it (FINDINGS 4), so it is inferred from the gaps in the
    sequence numbers that the depayloader meets: of what was resent or restored in time it meets
    none. 3 s without a frame are a gap, too: the numbers may have wrapped meanwhile. `concealment`
    infers the same afterwards, from the fates of all packets; there a frame is concealed that is
    not whole here.
    """

    def __init__(self) -> None:
        self.unbroken = False  # nothing can be predicted before the first keyframe
        self._gap_timestamp: int | None = None
        self._after_gap = False

    def gap(self, timestamp: int) -> None:
        """Packets are missing before the first one to come of the frame with this RTP timestamp.

        Which frame they were of is not known: it may be this one.
        """
        self.unbroken = False
        self._gap_timestamp, self._after_gap = timestamp, True

    def access_unit(self, timestamp: int, has_idr: bool, has_end: bool) -> bool:
        """Take in the end of a frame; True if it is whole.

        `has_end`: its last packet is here, as RTP's marker bit shows. The depayloader may hand out
        the remains of a frame before what follows the gap, or remains within what follows it.
        """
        is_complete = has_end and not self._after_gap and timestamp != self._gap_timestamp
        self._after_gap = False
        self.unbroken = is_complete and (has_idr or self.unbroken)
        return self.unbroken


def has_idr(access_unit: bytes) -> bool:
    """True if a slice of an IDR picture (H.264) is in it: no later frame needs one before it.

    Parameter sets alone make no keyframe, though GStreamer flags them as one.
    """
    at = 0
    while at + _LENGTH_BYTES < len(access_unit):
        if access_unit[at + _LENGTH_BYTES] & _TYPE == _IDR:
            return True
        at += _LENGTH_BYTES + int.from_bytes(access_unit[at : at + _LENGTH_BYTES])
    return False
