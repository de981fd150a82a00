"""The live line: what an operator or experimenter wants to see while a session runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Self, TypeAlias

from rich.console import Group
from rich.live import Live
from rich.text import Text

from tams_app.faces import episodes
from tams_app.faces.shown import hand_rows, slowest_text
from tams_app.faces.silence import NOT_LIVE, STILL_STOPS, not_received, silence_of
from tams_app.printing import Console, known
from tams_app.records import LINK_LOST, SessionState, ViewState
from tams_app.teleop.hands import words_of_hand
from tams_app.teleop.reasons import advice

LIVE_EVERY_S = 0.2
PLAIN_EVERY_S = 5.0  # where the output is no terminal
SEPARATOR = "  |  "

COLUMNS = 80

_STYLES = {"ENGAGED": "bold green", "HOLDING": "bold yellow", "FAULT": "bold red"}


@dataclass(frozen=True, slots=True)
class Words:
    """A state in words: `live` on a terminal, within COLUMNS; `plain`, in full, elsewhere.

    why: on a terminal below `live`, the episodes, why the arm does not move, what to do, and what
    makes the video late.
    """

    live: str
    plain: str
    why: str = ""


WordsOf: TypeAlias = Callable[[SessionState], Words]


def status_words(state: SessionState) -> Words:
    """The arm, the views, the link, and in full why the arm does not move."""
    told = [] if state.episodes is None else [episodes.line(state.episodes)]
    late = [slowest] if (slowest := slowest_text(state)) else []
    full = [
        arm_line(state),
        *told,
        "   ".join(_view(name, view, state.asked_fps) for name, view in state.views.items()),
        f"link {known(state.link_kbps)}/{known(state.budget_kbps)} kbit/s, "
        f"capacity {known(state.capacity_kbps)}, estimated {known(state.estimate_kbps)}, "
        f"queue {known(state.queue_ms)} ms{_ssim(state)}",
        *late,
        *reason_parts(state),
    ]
    why = "\n".join((*told, *reason_parts(state), *late))
    return Words(fitting(_parts(state)), SEPARATOR.join(full), why)


def fitting(parts: Iterable[str]) -> str:
    """As many of the parts as fit into COLUMNS, the first ones first."""
    line = ""
    for part in parts:
        longer = f"{line} {part}".strip()
        if len(longer) > COLUMNS:
            break
        line = longer
    return line


def arm_parts(state: SessionState) -> list[str]:
    """Time, arming, phase and deadman, in short; where nothing is live, since when."""
    if (silence_s := silence_of(state)) is not None:
        return [minutes(state.t_s), _not_live(state, silence_s)]
    deadman = "held" if state.deadman else "up"
    return [minutes(state.t_s), state.arming.upper(), state.phase, deadman]


def _parts(state: SessionState) -> list[str]:
    """The arm and, of the views, the primary one: what matters most comes first."""
    parts, views = arm_parts(state), state.views
    if state.episodes is not None:
        parts.append(episodes.now_text(state.episodes))
    if silence_of(state) is not None:
        return parts
    name = state.primary_view if state.primary_view in views else next(iter(views), "")
    link = f"link {known(state.link_kbps)}/{known(state.budget_kbps)}k"
    if name:
        view = views[name]
        parts += [
            f"{name} {known(view.sent_kbps)}/{known(view.target_kbps)}k",
            f"{known(view.age_ms)}ms",
            f"{known(view.fps)}/{known(state.asked_fps)}fps",
        ]
    return [*parts, link, f"q{known(state.queue_ms)}ms"]


def arm_line(state: SessionState) -> str:
    """Time, arming, phase, what the hand holds, and where the arm is; or that it is not live."""
    if (silence_s := silence_of(state)) is not None:
        return f"{minutes(state.t_s)}  {_not_live(state, silence_s)}"
    words = dict(hand_rows(state))
    held = words_of_hand(state.hand).deadman.removeprefix("the ")
    parts = [f"{held} {'held' if state.deadman else 'up'}", *state.pressed, words["mode"]]
    if state.tcp_mm is not None:
        x, y, z = state.tcp_mm
        parts += [f"TCP x {x:.0f} y {y:.0f} z {z:.0f} mm", f"gripper {words['gripper']}"]
        parts.append(f"motors {words['motors']}")
    return f"{minutes(state.t_s)}  {state.arming.upper()}  {state.phase}  {', '.join(parts)}"


def reason_parts(state: SessionState) -> list[str]:
    """The reason why the arm does not move and the remedy, or why it stopped last; else none."""
    if (silence_s := silence_of(state)) is not None:
        return [f"{not_received(silence_s)} {STILL_STOPS} still stops it."]
    if state.reason:
        return [advice(state.reason, state.lasting, words_of_hand(state.hand))]
    return [f"last stop: {state.last_stop}"] if state.last_stop else []


def _not_live(state: SessionState, silence_s: float) -> str:
    lost = "LINK LOST, " if state.arming == LINK_LOST else ""
    return f"{lost}{NOT_LIVE.upper()} for {silence_s:.1f} s"


def minutes(t_s: float) -> str:
    """Seconds as minutes and seconds."""
    whole, seconds = divmod(t_s, 60)
    return f"{whole:.0f}:{seconds:04.1f}"


class StatusLine:
    """Shows states in place at 5 Hz on a terminal, as plain lines every few seconds elsewhere.

    Use it as a context from one thread; `notify` prints a sentence that stays. `words_of` puts a
    state into words.
    """

    def __init__(self, console: Console, words_of: WordsOf = status_words) -> None:
        self._console = console
        self._words_of = words_of
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

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def is_due(self, t_s: float) -> bool:
        """True if a state of `t_s` would be shown: the last one was not shown a moment before.

        The time of a replay may go back: then it is.
        """
        return not self._next_s - self._every_s <= t_s < self._next_s

    def update(self, state: SessionState) -> None:
        """Show `state` if it is due."""
        if not self.is_due(state.t_s):
            return
        self._next_s = state.t_s + self._every_s
        words = self._words_of(state)
        if self._live is None:
            self._console.print(words.plain, soft_wrap=True)
            return
        text = Text(words.live, no_wrap=True, overflow="ellipsis")
        text.highlight_words([state.arming.upper()], _STYLES.get(state.arming.upper(), "bold"))
        why = [Text(words.why)] if words.why else []
        self._live.update(Group(text, *why), refresh=True)

    def notify(self, sentence: str, t_s: float) -> None:
        """Print a sentence above the line, with when it was shown."""
        printed = f"{minutes(t_s)}  {sentence}"
        self._console.print(printed, soft_wrap=True)


def _view(name: str, view: ViewState, asked_fps: float | None) -> str:
    return (
        f"{name} {known(view.sent_kbps)}/{known(view.target_kbps)} kbit/s "
        f"{known(view.fps)}/{known(asked_fps)} fps {known(view.age_ms)} ms"
    )


def _ssim(state: SessionState) -> str:
    view = state.views.get(state.primary_view)
    if view is None or view.live_ssim is None:
        return ""
    task = "" if view.task_live_ssim is None else f", {view.task_live_ssim:.2f} at the task"
    return f", live SSIM of {state.primary_view} {view.live_ssim:.2f}{task}"
