"""Whether a camera on the arm is where its calibration has it, judged by the frames that come.

A frame is drawn as it would look where the arm was when a later frame was captured, and compared
with that frame. Where pose and lens are right it is much more like it than the earlier frame is;
where they are wrong it is hardly more like it, or less.
"""

from __future__ import annotations

import math
from collections import deque

import cv2
import numpy as np

from tams_app.prediction.present import WristView
from tams_app.records import Pose, ShownFrame
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.ssim import FrameMoments, Luma, luma_of, ssim

# Figures of the choice: docs/MEASUREMENTS.md, "A camera that is not where it should be".
APART_NS = 300 * NS_PER_MS  # of the two frames at least: as late as a view is over a far link
_LATEST_NS = NS_PER_S  # and at most: an arm that is slower has rested between them
_EACH_NS = NS_PER_S  # one comparison, so that all of them cost little
_SIZE = 160, 120  # of the pictures that are compared [px]: small ones have little noise
_MOVED_M, _TURNED_RAD = 0.010, math.radians(2.0)  # else both frames show the same
_LEAST = 0.1  # dissimilarity of the two frames: a bare table tells nothing
COMPARED = 5  # that are judged together: seconds of motion
# Of the dissimilarity, what may be left: most of it, and the picture is no help. A right camera
# leaves .17 at most over the rig's table; things that stand high on a real one will leave more.
WORST = 0.6


class CameraCheck:
    """Give it each frame of the view that reaches the screen; one thread."""

    def __init__(self, view: WristView) -> None:
        """`view`: what corrects the frames."""
        self._view = view
        self._earlier: tuple[int, Luma] | None = None
        self._due_ns = 0
        self._found: deque[tuple[float, float]] = deque(maxlen=COMPARED)
        self.judged = 0  # comparisons so far
        self.fits = True

    @property
    def left(self) -> float | None:
        """The share of the dissimilarity that is left, of what is judged now; None: nothing yet."""
        received = sum(one for one, _ in self._found)
        return sum(other for _, other in self._found) / received if received else None

    def shown(self, frame: ShownFrame) -> bool:
        """A frame was shown, later than the last; True if the camera is found wrong by it.

        That is told once, and `fits` is False from then on.
        """
        if not self.fits or not frame.whole or frame.capture_ns < self._due_ns:
            return False
        if self._earlier is None or frame.capture_ns > self._earlier[0] + _LATEST_NS:
            self._earlier = frame.capture_ns, luma_of(frame.image)
        elif frame.capture_ns >= self._earlier[0] + APART_NS:
            earlier_ns, earlier = self._earlier
            then, now = (self._view.measured(t_ns) for t_ns in (earlier_ns, frame.capture_ns))
            if then is not None and now is not None and _is_motion(then, now):
                self._compare(earlier, then, frame, now)
        return not self.fits

    def _compare(self, earlier: Luma, then: Pose, later: ShownFrame, now: Pose) -> None:
        self._earlier, self._due_ns = None, later.capture_ns + _EACH_NS - APART_NS
        drawn = self._view.between(earlier, then, now)
        if drawn is None:
            return
        true, received, shown = (
            FrameMoments.of(_small(one)) for one in (luma_of(later.image), earlier, drawn)
        )
        unlike = 1.0 - ssim(true, received)
        if unlike < _LEAST:
            return
        self.judged += 1
        self._found.append((unlike, 1.0 - ssim(true, shown)))
        left = self.left
        self.fits = left is None or self.judged < COMPARED or left <= WORST


def _is_motion(then: Pose, now: Pose) -> bool:
    moved = now.position - then.position
    turned_rad = (now.rotation * then.rotation.inv()).magnitude()
    return math.sqrt(moved @ moved) >= _MOVED_M or turned_rad >= _TURNED_RAD


def _small(luma: Luma) -> Luma:
    return np.asarray(cv2.resize(luma, _SIZE, interpolation=cv2.INTER_AREA), np.uint8)
