"""The tones, and which of them a change of the arming state asks for; pure."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.records import LINK_LOST


@dataclass(frozen=True, slots=True)
class Tone:
    """A tone of one pitch; no two share pitch, length or waveform as GStreamer names it."""

    hz: int
    ms: int
    wave: str


HOLD, FAULT, READY_AGAIN = "hold", "fault", "ready again"
TONES = {
    HOLD: Tone(660, 250, "sine"),
    FAULT: Tone(330, 800, "square"),
    READY_AGAIN: Tone(990, 120, "triangle"),
}
_STOPS = {"holding": HOLD, LINK_LOST: HOLD, "fault": FAULT}  # by arming state


class ToneChoice:
    """Chooses the tone of each change; one stop has one tone, whatever it is called in between."""

    def __init__(self) -> None:
        self._stop: str | None = None  # the tone of the stop that lasts

    def step(self, arming: str) -> str | None:
        """The word of a tone of `TONES` that `arming` begins with, None if it has none."""
        if arming == "ready" and self._stop is not None:
            self._stop = None
            return READY_AGAIN
        tone = _STOPS.get(arming, self._stop)
        if tone == self._stop:
            return None
        self._stop = tone
        return tone
