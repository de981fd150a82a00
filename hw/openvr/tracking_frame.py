"""Whether the runtime's standing frame, in which every pose is given, is still the same one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.runtime.clock import NS_PER_S

TRUST_AFTER_NS = NS_PER_S  # the trigger must have been up for this long
TRIGGER_UP = 0.2
_SAME_WITHIN_M = 0.005
_SAME_WITHIN_RAD = np.radians(0.5)


def frame_events(vr: Any) -> frozenset[int]:
    """The events that say that the frame was moved: recentred, or another room."""
    return frozenset(
        {
            vr.VREvent_ChaperoneDataHasChanged,
            vr.VREvent_ChaperoneUniverseHasChanged,
            vr.VREvent_ChaperoneRoomSetupCommitted,
            vr.VREvent_SeatedZeroPoseReset,
            vr.VREvent_StandingZeroPoseReset,
        }
    )


class FrameKeeper:
    """Notices that the operator's directions have turned, or his place has moved.

    Recentring the headset turns the frame under a hand that goes on as before: "forward" then
    leads the arm elsewhere. So from a change on nothing counts until the trigger was seen up for
    TRUST_AFTER_NS without a break. Keep one over all connections: a runtime that was restarted
    may have another frame than before.
    """

    def __init__(self) -> None:
        self._frame: NDArray[np.float64] | None = None
        self._changed = False
        self._up_since_ns: int | None = None

    def note_event(self) -> None:
        """The runtime says that the frame was moved."""
        self._changed, self._up_since_ns = True, None

    def look(self, raw_to_standing: Any) -> None:
        """Compare an HmdMatrix34_t, from the tracking's own frame to the standing one.

        Slow corrections of the runtime count once they add up.
        """
        raw = np.frombuffer(bytes(raw_to_standing), dtype=np.float32)
        frame = raw.reshape(3, 4).astype(np.float64)
        if self._frame is None:
            self._frame = frame
        elif not _is_same(frame, self._frame):
            self._frame = frame
            self.note_event()

    def is_changed(self, trigger: float | None, now_ns: int) -> bool:
        """Whether poses are not to be trusted yet; `trigger` is None where it cannot be read."""
        if not self._changed:
            return False
        if trigger is None or not trigger <= TRIGGER_UP:
            self._up_since_ns = None
        elif self._up_since_ns is None:
            self._up_since_ns = now_ns
        elif now_ns - self._up_since_ns >= TRUST_AFTER_NS:
            self._changed = False
        return self._changed


def _is_same(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """False also for what is not a number."""
    moved_m = np.linalg.norm(a[:, 3] - b[:, 3])
    # of a small turn: the Frobenius norm of the difference is the angle times the root of 2
    turned_rad = np.linalg.norm(a[:, :3] - b[:, :3]) / np.sqrt(2.0)
    return bool(moved_m <= _SAME_WITHIN_M and turned_rad <= _SAME_WITHIN_RAD)
