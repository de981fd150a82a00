"""Two confirmations are two presses: a key that is held repeats, and a repeat confirms nothing."""

from __future__ import annotations

from tams_app.runtime.clock import NS_PER_MS

REPEAT_NS = 700 * NS_PER_MS  # a held key repeats after up to 0.66 s (X11's default), then faster


class Confirmations:
    """Tells the presses of a key from its auto-repeats; what follows too soon is one."""

    def __init__(self) -> None:
        self._seen_ns: int | None = None

    def counts(self, now_ns: int) -> bool:
        """Whether the key seen at `now_ns` was pressed anew; also one that does not is seen."""
        before_ns, self._seen_ns = self._seen_ns, now_ns
        return before_ns is None or now_ns - before_ns >= REPEAT_NS
