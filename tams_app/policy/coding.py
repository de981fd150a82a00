"""What the encoders' own figures tell of a view: how many bits it can use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from tams_app.records import CodedFrame
from tams_app.units import NS_PER_S

WINDOW_FRAMES = 9  # .3 s of 30 a second
OLDEST_NS = NS_PER_S
_FEWEST = 5  # frames with a QP: fewer tell nothing
_QP_PER_DOUBLING = 6.0  # of the quantiser's step


@dataclass(frozen=True, slots=True)
class ViewCoding:
    """Rate and quantisation of one view over its last `WINDOW_FRAMES`."""

    kbps: float  # of coded frames, without headers and repair
    qp: float  # median

    def kbps_at(self, qp: float) -> float:
        """The rate of this content at another `qp`, taken as inverse to the quantiser's step."""
        return self.kbps * float(2.0 ** ((self.qp - qp) / _QP_PER_DOUBLING))


class CodingStatistics:
    """The newest `ViewCoding` of each view, as far as its frames tell it."""

    def __init__(self) -> None:
        self._frames: dict[str, deque[CodedFrame]] = {}

    def observe(self, now_ns: int, coded: Iterable[CodedFrame]) -> None:
        """Take in new frames, of each view in their order; forget the old."""
        for frame in coded:
            if frame.qp is not None:
                kept = self._frames.setdefault(frame.view, deque(maxlen=WINDOW_FRAMES))
                kept.append(frame)
        for frames in self._frames.values():
            while frames and frames[0].encoded_ns <= now_ns - OLDEST_NS:
                frames.popleft()

    def view(self, name: str) -> ViewCoding | None:
        """None while there is too little to tell."""
        frames = self._frames.get(name)
        if frames is None or len(frames) < _FEWEST:
            return None
        span_ns = frames[-1].encoded_ns - frames[0].encoded_ns
        size_bytes = sum(frame.size_bytes for frame in frames) - frames[0].size_bytes
        if span_ns <= 0 or size_bytes <= 0:
            return None
        kbps = size_bytes * 8 / 1000 / (span_ns / NS_PER_S)
        return ViewCoding(kbps, median(frame.qp for frame in frames if frame.qp is not None))
