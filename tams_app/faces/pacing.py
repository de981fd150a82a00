"""The pace of the window's drawing: that of the frames, within a share of one core; pure."""

from __future__ import annotations

from tams_app.units import NS_PER_MS, NS_PER_S

SHARE = 0.25  # of a core: a graphics processor needs less for 30 frames a second of three views
LEAST_NS = 22 * NS_PER_MS  # the views' frames come one after the other: some go together
MOST_NS = 250 * NS_PER_MS
_JUDGED_NS = NS_PER_S // 2


class Pacer:
    """Decides when to draw; what is drawn then is always the newest, so a slow one is never late.

    The cost of a drawing is what the whole process used of the processor since the last judgement,
    by the drawings since: software rendering works in threads of its own, after the drawing.
    """

    def __init__(self, now_ns: int, used_ns: int) -> None:
        """`used_ns`: processor time of the process so far, all its threads."""
        self.interval_ns = LEAST_NS
        self._drawn_ns = 0
        self._drawings = 0
        self._judged_ns, self._used_ns = now_ns, used_ns

    def may_draw(self, now_ns: int) -> bool:
        """True if it is time to draw again, if there is something new."""
        return now_ns - self._drawn_ns >= self.interval_ns

    def drawn(self, now_ns: int, used_ns: int) -> None:
        """A drawing was made; `used_ns` as above."""
        self._drawn_ns = now_ns
        self._drawings += 1
        if now_ns - self._judged_ns >= _JUDGED_NS:
            cost_ns = (used_ns - self._used_ns) / self._drawings
            self.interval_ns = min(max(LEAST_NS, round(cost_ns / SHARE)), MOST_NS)
            self._judged_ns, self._used_ns, self._drawings = now_ns, used_ns, 0
