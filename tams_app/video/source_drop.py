"""Leaving out whole frames at the source when a view's target would starve the encoder."""

from __future__ import annotations


class SourceDrop:
    """Keeps the fraction of frames that the target can pay for at `threshold_kbps` each second.

    Each frame earns target/threshold of a frame; a whole one is spent to keep it. So the kept
    frames have the bits that `threshold_kbps` would give them, and are spread evenly.
    """

    def __init__(self, threshold_kbps: float) -> None:
        self._threshold_kbps = threshold_kbps
        self._credit = 1.0  # the first frame is the keyframe: keep it

    def keep(self, target_kbps: float) -> bool:
        """Whether the next captured frame is encoded, at the view's present target."""
        kept = self._credit >= 1.0
        if kept:
            self._credit -= 1.0
        self._credit += target_kbps / self.frame_target_kbps(target_kbps)
        return kept

    def frame_target_kbps(self, target_kbps: float) -> float:
        """What the kept frames would cost at the full frame rate."""
        return max(target_kbps, self._threshold_kbps)
