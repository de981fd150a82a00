"""Keys that are down, distinguished from a held key's auto-repeat; pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from tams_app.faces import episodes
from tams_app.faces.commands import LETTERS, PHASE_KEYS, Command
from tams_app.faces.messages import Opening
from tams_app.faces.terminal.keys import REPEAT_NS
from tams_app.teleop.hands import words_of_hand

COMMANDS = {
    "Return": Command.CONFIRM,
    "KP_Enter": Command.CONFIRM,
    "space": Command.EMERGENCY_STOP,
    "Escape": Command.EMERGENCY_STOP,
    "Page_Down": Command.EPISODE,  # which pedals and presenters send
    "Page_Up": Command.DISCARD,
    "BackSpace": Command.NO_DROP,
    **LETTERS,
}
_STOP_HELP = (("Space, Esc", "emergency stop; also the red button"),)
_WINDOW_HELP = (
    ("Q", "end the session; the arm stops first"),
    ("F1", "show or hide this list"),
    ("F11", "whole screen, or a window again"),
)
_CORRECTED_HELP = (("F2", "show all views as received, or predicted again"),)
_VIEWS_HELP = (
    ("1, 2, 3 …", "pin this view: large, and in a session the primary one; again: let it go"),
    ("Tab", "exchange the large view with the first small one, and pin that"),
)
_TRIAL_HELP = (
    ("P", "the block is placed: end the trial"),
    ("X / Backspace", "count a drop / one drop less"),
)
_REPLAY_HELP = (
    ("Enter, Space", "pause, or go on; also the button"),
    ("Left, Right", "5 s back, 5 s forward"),
    ("Down, Up", "slower, faster"),
    ("Page Up, Page Down", "pause, 0.1 s back, 0.1 s forward"),
    ("Home, End", "to the beginning, to the end"),
    ("G", "to the gripper's next command"),
    ("mouse", "click or drag in the bar below the views: go there"),
    ("Q", "end the replay"),
    *_WINDOW_HELP[1:],
)
_MARKING_HELP = (
    *((key, f"{one or 'no phase'} from here on") for key, one in PHASE_KEYS.items()),
    ("Backspace", "undo the last mark before this moment"),
)


def key_help(opening: Opening) -> tuple[tuple[str, str], ...]:
    """All keys with what they do, and the controls of its hand."""
    if opening.replay is not None:
        return (*(_MARKING_HELP if opening.blind else _VIEWS_HELP), *_REPLAY_HELP)
    of_trial = _TRIAL_HELP if opening.blind else _VIEWS_HELP
    words = words_of_hand(opening.hand)
    of_episodes: tuple[tuple[str, str], ...] = episodes.KEYS if opening.has_episodes else ()
    if opening.has_episodes and opening.hand == "openvr":
        of_episodes += (episodes.BUTTONS,)
    confirm = f"confirm: arm, clear a fault (release {words.deadman} first)"
    return (
        *_STOP_HELP,
        ("Enter", confirm),
        *_WINDOW_HELP,
        *(_CORRECTED_HELP if opening.cameras else ()),
        *of_trial,
        *of_episodes,
        *words.controls,
    )


SHIFTS = frozenset({"Shift_L", "Shift_R"})
_LATIN_BELOW = 0x250  # Unicode: Latin letters with and without accents, digits, punctuation
_US_ROWS = {24: "qwertyuiop", 38: "asdfghjkl", 52: "zxcvbnm"}  # X11 and Wayland: evdev's + 8
_US_LETTERS = {
    first + place: letter for first, row in _US_ROWS.items() for place, letter in enumerate(row)
}


class Symbol(NamedTuple):
    """A key's meaning in one layout: `layout` counts from 0, `level` 0 is without modifiers.

    character: Unicode, 0 for a key that types none.
    """

    layout: int
    level: int
    name: str
    character: int


def key_name(code: int, layout: int, symbols: Iterable[Symbol]) -> str:
    """One name for a key, whatever modifiers are down and whichever layout is active.

    A digit where the active layout has one on it, with Shift or NumLock or without. Else what it
    means without modifiers in the active layout; where that is no Latin letter, in the first of the
    other layouts in which it is; where there is none, the letter that a US keyboard has there.
    "" for a key that means nothing.
    """
    symbols = list(symbols)
    for one in symbols:
        if one.layout == layout and one.level < 2 and one.name.removeprefix("KP_") in PHASE_KEYS:
            return one.name.removeprefix("KP_")
    plain = sorted(
        (one for one in symbols if one.level == 0 and one.name),
        key=lambda one: (one.layout != layout, one.layout),
    )
    latin = next((one.name for one in plain if one.character < _LATIN_BELOW), "")
    return latin or _US_LETTERS.get(code, plain[0].name if plain else "")


class Keyboard:
    """The keys of one window, by their hardware codes: a release may come under another name.

    A press counts once, until its release. A key that was down before the window had the focus is
    seen only by its repeats, so one that comes within REPEAT_NS of the focus, or of its own last
    repeat, is no press unless its release was seen since. A Shift key counts as held only while the
    seat's modifiers have Shift (`modifiers`), and no more once they have lost it.
    """

    def __init__(self) -> None:
        self.focused = False
        self.presses: Counter[str] = Counter()  # how often each key has gone down, by name
        self._held: dict[int, str] = {}  # code → name at the press
        self._free: set[int] = set()  # seen going up since the focus came
        self._seen_ns: dict[int, int] = {}
        self._focused_ns = 0
        self._has_shift = False
        self._shifting: set[int] = set()  # Shift keys that were down while the modifiers had Shift

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the keys that are down, in the order of pressing."""
        names = dict.fromkeys(self._held.values())
        return tuple(name for name in names if self._has_shift or name not in SHIFTS)

    @property
    def shift_is_dead(self) -> bool:
        """True if Shift is down but does not count: it must be released and pressed again."""
        return self.focused and self._has_shift and SHIFTS.isdisjoint(self._held.values())

    def focus(self, focused: bool, now_ns: int) -> None:
        """The window gets or loses the focus: without it no release is seen, so no key is held.

        A window that the operator does not see has none (`faces.window.sight`).
        """
        self.focused = focused
        self._held.clear()
        self._free.clear()
        self._shifting.clear()
        self._focused_ns = now_ns

    def press(self, code: int, name: str, now_ns: int) -> bool:
        """A press or a repeat of it; whether it is a new press."""
        if not self.focused or code in self._held:
            return False
        before_ns = max(self._focused_ns, self._seen_ns.get(code, 0))
        self._seen_ns[code] = now_ns
        if code not in self._free and now_ns - before_ns < REPEAT_NS:
            return False
        self._held[code] = name
        self.presses[name] += 1
        return True

    def release(self, code: int) -> None:
        """The key goes up."""
        self._held.pop(code, None)
        self._shifting.discard(code)
        self._free.add(code)

    def modifiers(self, has_shift: bool, now_ns: int) -> None:
        """Take in the seat's modifiers, and so whether Shift is down; they follow a press later."""
        self._has_shift = has_shift
        if has_shift:
            self._shifting.update(code for code, name in self._held.items() if name in SHIFTS)
            return
        for code in self._shifting:  # its release was not seen, or it has become another key
            self._held.pop(code, None)
            self._free.discard(code)
            self._seen_ns[code] = now_ns
        self._shifting.clear()


def command_of(name: str, is_new: bool, replay: bool = False) -> Command | None:
    """The command of a key; an emergency stop counts also where it may be a repeat.

    Where nothing moves, as in a replay, there is none: its keys confirm.
    """
    command = COMMANDS.get(name)
    if replay and command is Command.EMERGENCY_STOP:
        command = Command.CONFIRM
    return command if is_new or command is Command.EMERGENCY_STOP else None
