"""Which captured frame is this? From times alone, exact also under loss (FINDINGS 4)."""

from __future__ import annotations

from tams_app.clock import NS_PER_S

RTP_CLOCK_HZ = 90_000


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
    """Capture indices of one receiver's pictures, anchored at its first packet.

    A jitter buffer with mode=none makes PTS a linear function of the RTP timestamp, so that
    n = n₀ + round((pts − pts₀)·fps). Both times of the anchor are those of the same packet.
    """

    def __init__(self, fps: int, pts_ns: int, rtp_timestamp: int) -> None:
        self._fps = fps
        self._first_index = index_of_rtp_timestamp(rtp_timestamp, fps)
        self._first_pts_ns = pts_ns

    def index(self, pts_ns: int) -> int:
        """The capture index of the picture with presentation time `pts_ns`."""
        return self._first_index + index_of_pts(pts_ns - self._first_pts_ns, self._fps)
