"""The live line: what an operator or experimenter wants to see while a session runs."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from tams_app.session.status import StatusSnapshot, ViewStatus

LIVE_EVERY_S = 0.2
PLAIN_EVERY_S = 5.0  # where the output is no terminal

_STYLES = {"ENGAGED": "bold green", "HOLDING": "bold yellow", "FAULT": "bold red"}


def status_lines(snapshot: StatusSnapshot) -> list[str]:
    """The snapshot in words: the arm, the views, the link, and the last reason if there is one."""
    deadman = "trigger held" if snapshot.deadman else "trigger up"
    mode = "orientation" if snapshot.orientation_mode else "translation"
    lines = [
        f"{_clock(snapshot.t_s)}  {snapshot.arming.upper()}  {snapshot.phase}  "
        f"{', '.join((deadman, *snapshot.pressed, mode))}"
        f"{_tcp(snapshot.tcp_mm)}{_gripper(snapshot.gripper_closed)}",
        "   ".join(_view(name, view) for name, view in snapshot.views.items()),
        f"link {_whole(snapshot.link_kbps)}/{_whole(snapshot.capacity_kbps)} kbit/s, "
        f"queue {_whole(snapshot.queue_ms)} ms",
    ]
    if snapshot.reason:
        lines.append(f"last stop: {snapshot.reason}")
    return lines


class StatusLine:
    """Shows snapshots in place at 5 Hz on a terminal, as plain lines every few seconds elsewhere.

    Use it as a context from one thread; `say` prints a sentence that stays.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = (
            Live(console=console, auto_refresh=False, transient=True)
            if console.is_terminal
            else None
        )
        self._every_s = LIVE_EVERY_S if self._live else PLAIN_EVERY_S
        self._next_s = 0.0

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, snapshot: StatusSnapshot) -> None:
        """Show `snapshot`, unless the last one was shown a moment ago."""
        if snapshot.t_s < self._next_s:
            return
        self._next_s = snapshot.t_s + self._every_s
        lines = status_lines(snapshot)
        if self._live is None:
            self._console.print("  |  ".join(lines), markup=False, highlight=False, soft_wrap=True)
            return
        text = Text("\n".join(lines), no_wrap=True, overflow="ellipsis")
        text.highlight_words(
            [snapshot.arming.upper()], _STYLES.get(snapshot.arming.upper(), "bold")
        )
        self._live.update(text, refresh=True)

    def say(self, sentence: str) -> None:
        """Print a sentence above the line."""
        self._console.print(sentence, markup=False, highlight=False, soft_wrap=True)


def _tcp(tcp_mm: tuple[float, float, float] | None) -> str:
    if tcp_mm is None:
        return ""
    x, y, z = tcp_mm
    return f", TCP x {x:.0f} y {y:.0f} z {z:.0f} mm"


def _gripper(closed: bool | None) -> str:
    if closed is None:
        return ""
    return f", gripper {'closed' if closed else 'open'}"


def _view(name: str, view: ViewStatus) -> str:
    return (
        f"{name} {_whole(view.sent_kbps)}/{_whole(view.target_kbps)} kbit/s "
        f"{_whole(view.shown_age_ms)} ms"
    )


def _whole(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}"


def _clock(t_s: float) -> str:
    minutes, seconds = divmod(t_s, 60)
    return f"{minutes:.0f}:{seconds:04.1f}"
