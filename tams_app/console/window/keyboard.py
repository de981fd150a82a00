"""Keys that are down, told apart from a held key's auto-repeat; pure."""

from __future__ import annotations

from tams_app.console.terminal import REPEAT_NS
from tams_app.console.wishes import Wish
from tams_app.teleop.hands import HANDS

WISHES = {
    "Return": Wish.CONFIRM,
    "KP_Enter": Wish.CONFIRM,
    "space": Wish.EMERGENCY_STOP,
    "Escape": Wish.EMERGENCY_STOP,
    "q": Wish.QUIT,
    "x": Wish.DROP,
    "BackSpace": Wish.NO_DROP,
    "p": Wish.PLACED,
}
_STOP_HELP = (("Space, Esc", "emergency stop; also the red button"),)
_WINDOW_HELP = (
    ("Q", "end the session; the arm stops first"),
    ("F1", "show or hide this list"),
    ("F11", "whole screen, or a window again"),
)
_TRIAL_HELP = (
    ("P", "the block is placed: end the trial"),
    ("X / Backspace", "count a drop / one drop less"),
)
_REPLAY_HELP = (
    ("Enter, Space", "pause, or go on; also the red button"),
    ("Left, Right", "5 s back, 5 s forward"),
    ("Down, Up", "slower, faster"),
    ("Home, End", "to the beginning, to the end"),
    ("mouse", "click or drag in the bar below the views: go there"),
    ("Q", "end the replay"),
    *_WINDOW_HELP[1:],
)


def key_help(hand: str, replay: bool = False, trial: bool = False) -> tuple[tuple[str, str], ...]:
    """All keys with what they do, and the controls of `hand` (`HANDS`)."""
    if replay:
        return _REPLAY_HELP
    of_trial = _TRIAL_HELP if trial else ()
    confirm = f"confirm: arm the arm, clear a fault (release {HANDS[hand].deadman} first)"
    return (*_STOP_HELP, ("Enter", confirm), *_WINDOW_HELP, *of_trial, *HANDS[hand].controls)


class Keyboard:
    """The keys of one window.

    A press counts once, until its release. A key that was down before the window had the focus is
    seen only by its repeats, so one that comes within REPEAT_NS of the focus, or of its own last
    repeat, is no press unless its release was seen since.
    """

    def __init__(self) -> None:
        self.focused = False
        self._held: dict[str, None] = {}
        self._free: set[str] = set()  # seen going up since the focus came
        self._seen_ns: dict[str, int] = {}
        self._focused_ns = 0

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the keys that are down, in the order of pressing."""
        return tuple(self._held)

    def focus(self, focused: bool, now_ns: int) -> None:
        """The window gets or loses the focus: without it no release is seen, so no key is held."""
        self.focused = focused
        self._held.clear()
        self._free.clear()
        self._focused_ns = now_ns

    def press(self, name: str, now_ns: int) -> bool:
        """A press or a repeat of it; whether it is a new press."""
        if name in self._held:
            return False
        before_ns = max(self._focused_ns, self._seen_ns.get(name, 0))
        self._seen_ns[name] = now_ns
        if name not in self._free and now_ns - before_ns < REPEAT_NS:
            return False
        self._held[name] = None
        return True

    def release(self, name: str) -> None:
        """The key goes up."""
        self._held.pop(name, None)
        self._free.add(name)


def wish_of(name: str, is_new: bool, replay: bool = False) -> Wish | None:
    """What a key asks for; an emergency stop counts also where it may be a repeat.

    Where nothing moves, as in a replay, there is none: its keys confirm.
    """
    wish = WISHES.get(name)
    if replay and wish is Wish.EMERGENCY_STOP:
        wish = Wish.CONFIRM
    return wish if is_new or wish is Wish.EMERGENCY_STOP else None
