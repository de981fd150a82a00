"""The pace of a face's drawing: that of the frames, within a share of one core; pure."""

from __future__ import annotations

from tams_app.units import NS_PER_MS, NS_PER_S

SHARE = 0.25  # of a core: a graphics processor needs less for 30 frames a second of three views
LEAST_NS = 22 * NS_PER_MS  # the views' frames come one after the other: some go together
MOST_NS = 250 * NS_PER_MS
EARLY_NS = 16 * NS_PER_MS  # a frame that comes so long before its time is not put off
FOLLOWS_NS = 50 * NS_PER_MS  # for so long all others wait for the large picture's next frame
_JUDGED_NS = NS_PER_S // 2


class DrawPacer:
    """Decides when to draw; what is drawn then is always the newest, so a slow one is never late.

    Frames of the large picture are drawn as they come, and the other views' with them, or they are
    left to the next one: drawn between two they would be older, and put off the second. So the
    intervals are not even, only their mean is kept.

    The cost of a drawing is what the whole process used of the processor since the last judgement,
    by the drawings since: software rendering works in threads of its own, after the drawing.
    """

    def __init__(self, now_ns: int, used_ns: int) -> None:
        """`used_ns`: processor time of the process so far, all its threads."""
        self.interval_ns = LEAST_NS
        self._due_ns = 0
        self._newest: object = None
        self._drawings = 0
        self._judged_ns, self._used_ns = now_ns, used_ns

    def may_draw(self, now_ns: int, newest: object) -> bool:
        """True if it is time to draw again, if there is something new; ask often.

        `newest`: what the newest frame of the large picture is known by.
        """
        has_come, self._newest = newest != self._newest, newest
        return now_ns - self._due_ns >= (-EARLY_NS if has_come else FOLLOWS_NS)

    def drawn(self, now_ns: int, used_ns: int) -> None:
        """A drawing was made; `used_ns` as above."""
        self._due_ns = max(self._due_ns, now_ns - EARLY_NS) + self.interval_ns
        self._drawings += 1
        if now_ns - self._judged_ns >= _JUDGED_NS:
            cost_ns = (used_ns - self._used_ns) / self._drawings
            self.interval_ns = min(max(LEAST_NS, round(cost_ns / SHARE)), MOST_NS)
            self._judged_ns, self._used_ns, self._drawings = now_ns, used_ns, 0
