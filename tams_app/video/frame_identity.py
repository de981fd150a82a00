"""Which captured frame is this? From times alone, exact also under loss (FINDINGS 4)."""

from __future__ import annotations

from tams_app.units import NS_PER_S

RTP_CLOCK_HZ = 90_000
_RTP_TIMESTAMPS = 1 << 32


def pts_of_index(index: int, fps: int) -> int:
    """Presentation time [ns] of a captured frame, relative to the stream's start."""
    return index * NS_PER_S // fps


def index_of_pts(pts_ns: int, fps: int) -> int:
    """The captured frame a presentation time [ns] stands for; it was rounded down, so round."""
    return (2 * pts_ns * fps + NS_PER_S) // (2 * NS_PER_S)


def index_of_rtp_timestamp(timestamp: int, fps: int) -> int:
    """The captured frame of an RTP timestamp; sent with offset 0, it wraps after 13 hours."""
    return (2 * timestamp * fps + RTP_CLOCK_HZ) // (2 * RTP_CLOCK_HZ)


class FrameIdentity:
    """Capture indices of one receiver's frames, anchored at its first packet.

    A jitter buffer with mode=none makes PTS a linear function of the RTP timestamp, so that
    n = n₀ + round((pts − pts₀)·fps). Both times of the anchor are those of the same packet.
    After 3 s without packets it restarts its PTS from 0: `follow` tells what they lack then.
    """

    def __init__(self, fps: int, pts_ns: int, rtp_timestamp: int) -> None:
        self._fps = fps
        self._first_index = index_of_rtp_timestamp(rtp_timestamp, fps)
        self._first_pts_ns = pts_ns
        self._last_timestamp = rtp_timestamp
        self._ticks = 0  # from the first packet to the last one followed

    def index(self, pts_ns: int) -> int:
        """The capture index of the frame with presentation time `pts_ns`."""
        return self._first_index + index_of_pts(pts_ns - self._first_pts_ns, self._fps)

    def follow(self, pts_ns: int, rtp_timestamp: int) -> int:
        """What the PTS of this packet and its successors lack [ns]; 0 while they are in line.

        Call it with packets less than 6 hours apart: it counts timestamps through their wrap.
        """
        step = (rtp_timestamp - self._last_timestamp) % _RTP_TIMESTAMPS
        self._ticks += step - _RTP_TIMESTAMPS if step >= _RTP_TIMESTAMPS // 2 else step
        self._last_timestamp = rtp_timestamp
        missing_ns = self._first_pts_ns + self._ticks * NS_PER_S // RTP_CLOCK_HZ - pts_ns
        in_line = abs(missing_ns) * 2 * self._fps < NS_PER_S
        return 0 if in_line else missing_ns
