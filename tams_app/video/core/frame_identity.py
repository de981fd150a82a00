"""Identity of a received frame by its RTP timestamp, exact also under loss (FINDINGS 4).

A timestamp counts from the capture of the stream's first frame, as RTP wants it, at whatever rate
frames come. `SentFrames`, on the sender's side, knows what each stands for. `RtpTimes`, on the
receiver's, gets the timestamps back from the decoder. Between them goes the timestamp alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from tams_app.units import NS_PER_MS, NS_PER_S

RTP_CLOCK_HZ = 90_000
_RTP_TIMESTAMPS = 1 << 32
_REMEMBERED = 600  # frames; ten seconds at 60 a second: no network keeps any for as long
_IN_LINE_NS = 5 * NS_PER_MS  # half of the least time between two frames


def rtp_timestamp(pts_ns: int) -> int:
    """The timestamp that the payloader makes of a presentation time [ns]: rounded down."""
    return pts_ns * RTP_CLOCK_HZ // NS_PER_S % _RTP_TIMESTAMPS


def _ticks(duration_ns: int) -> int:
    """To the nearest tick of RTP's clock."""
    return (2 * duration_ns * RTP_CLOCK_HZ + NS_PER_S) // (2 * NS_PER_S)


@dataclass(frozen=True, slots=True)
class SentFrame:
    """The capture that a timestamp stands for, and when it was handed to the sender [ns].

    `ready_ns`: as in `Frame`.
    """

    index: int
    capture_ns: int
    pushed_ns: int
    ready_ns: int = 0


Identify: TypeAlias = Callable[[int], SentFrame | None]
"""Which capture an RTP timestamp stands for (`SentFrames.find`); None: it is not known."""


class SentFrames:
    """The last frames of one view's stream by RTP timestamp.

    `add` from one thread, `find` from any: a dict does each of its operations at once.
    """

    def __init__(self) -> None:
        self.first_ns: int | None = None  # capture time of the frame with RTP timestamp 0
        self._last_ticks = -1
        self._frames: dict[int, SentFrame] = {}  # oldest first

    def add(self, frame: SentFrame) -> int:
        """Remember the next frame of the stream; its presentation time [ns]."""
        if self.first_ns is None:
            self.first_ns = frame.capture_ns
        ticks = _ticks(frame.capture_ns - self.first_ns)
        self._last_ticks = ticks = max(ticks, self._last_ticks + 1)
        self._frames[ticks % _RTP_TIMESTAMPS] = frame
        if len(self._frames) > _REMEMBERED:
            del self._frames[next(iter(self._frames))]
        return -(-ticks * NS_PER_S // RTP_CLOCK_HZ)  # rounded up: `rtp_timestamp` rounds down

    def find(self, timestamp: int) -> SentFrame | None:
        """The frame of an RTP timestamp; None if that is not remembered."""
        return self._frames.get(timestamp)


class RtpTimes:
    """RTP timestamps of one receiver's frames, anchored at its first packet.

    A jitter buffer with mode=none makes PTS a linear function of the RTP timestamp. Both times of
    the anchor are those of the same packet. After 3 s without packets it restarts its PTS from 0:
    `follow` shows what they lack then.
    """

    def __init__(self, pts_ns: int, timestamp: int) -> None:
        self._first_pts_ns = pts_ns
        self._first_timestamp = self._last_timestamp = timestamp
        self._ticks = 0  # from the first packet to the last one followed

    @property
    def followed_ns(self) -> int:
        """Capture time of the last packet followed, since the first one's [ns]."""
        return self._ticks * NS_PER_S // RTP_CLOCK_HZ

    def timestamp(self, pts_ns: int) -> int:
        return (self._first_timestamp + _ticks(pts_ns - self._first_pts_ns)) % _RTP_TIMESTAMPS

    def follow(self, pts_ns: int, timestamp: int) -> int:
        """The correction of this packet's PTS and its successors' [ns]; 0 while they are in line.

        Call it with packets less than 6 hours apart: it counts timestamps through their wrap.
        """
        step = (timestamp - self._last_timestamp) % _RTP_TIMESTAMPS
        self._ticks += step - _RTP_TIMESTAMPS if step >= _RTP_TIMESTAMPS // 2 else step
        self._last_timestamp = timestamp
        missing_ns = self._first_pts_ns + self.followed_ns - pts_ns
        return 0 if abs(missing_ns) < _IN_LINE_NS else missing_ns


def capture_of(timestamp: int, first_ns: int, near_ns: int) -> int:
    """Capture time [ns] of the frame with an RTP timestamp, `first_ns` being that of timestamp 0.

    `near_ns`: a time less than 6 hours from it, which gives how often the timestamps have wrapped.
    """
    ticks = _ticks(near_ns - first_ns)
    step = (timestamp - ticks) % _RTP_TIMESTAMPS
    ticks += step - _RTP_TIMESTAMPS if step >= _RTP_TIMESTAMPS // 2 else step
    return first_ns + ticks * NS_PER_S // RTP_CLOCK_HZ
