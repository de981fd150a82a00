"""Vibrations in the operator's hand: one pattern for each pulse, distinguished blind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tams_app.records import Haptic
from tams_app.units import NS_PER_MS, NS_PER_S

MIN_GAP_NS = 5 * NS_PER_MS  # a runtime may ignore what comes sooner


@dataclass(frozen=True, slots=True)
class Vibration:
    """One stretch of vibration; amplitude 0..1."""

    duration_s: float
    frequency_hz: float
    amplitude: float


# (start after the beginning [s], vibration)
PATTERNS: dict[Haptic, tuple[tuple[float, Vibration], ...]] = {
    Haptic.ENGAGE: ((0.0, Vibration(0.06, 160.0, 0.8)),),
    Haptic.RELEASE: ((0.0, Vibration(0.03, 80.0, 0.4)),),
    Haptic.LIMIT: (
        (0.0, Vibration(0.02, 240.0, 0.6)),
        (0.06, Vibration(0.02, 240.0, 0.6)),
    ),
    Haptic.FAULT: tuple((start_s, Vibration(0.16, 120.0, 1.0)) for start_s in (0.0, 0.24, 0.48)),
}
# A hold or a fault by the link ends with a long one.
PATTERNS[Haptic.LINK_HOLD] = (*PATTERNS[Haptic.LIMIT], (0.14, Vibration(0.4, 160.0, 0.6)))
PATTERNS[Haptic.LINK_FAULT] = (*PATTERNS[Haptic.FAULT], (0.72, Vibration(0.4, 160.0, 0.6)))


class HapticPlayer:
    """Plays one pattern at a time: a new one cuts the old one off, but nothing cuts off a fault."""

    def __init__(self) -> None:
        self._pending: deque[tuple[int, Vibration]] = deque()
        self._playing: Haptic | None = None
        self._handed_ns = -MIN_GAP_NS

    def start(self, haptic: Haptic, now_ns: int) -> None:
        """Play from now on."""
        if self._pending and self._playing is not None and self._playing.is_fault:
            return
        self._playing = haptic
        self._pending = deque(
            (now_ns + round(start_s * NS_PER_S), vibration)
            for start_s, vibration in PATTERNS[haptic]
        )

    def due(self, now_ns: int) -> Vibration | None:
        """The vibration to hand to the device now; the newest if several have become due."""
        found = None
        if now_ns - self._handed_ns < MIN_GAP_NS:
            return found
        while self._pending and self._pending[0][0] <= now_ns:
            found = self._pending.popleft()[1]
            self._handed_ns = now_ns
        return found

    def silence(self) -> None:
        """Forget what is still to come."""
        self._pending.clear()
