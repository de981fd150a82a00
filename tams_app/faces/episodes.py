"""The episodes of a session, as they are written on the screen; pure."""

from __future__ import annotations

from tams_app.records import EpisodesState, EpisodeState
from tams_app.task.episodes import ARMED_NS, verdict
from tams_app.units import NS_PER_S

KEYS = (
    ("E, Page Down", "begin an episode / end and keep it; a pedal may send either key"),
    ("Z, Page Up", "discard the running or the last one: press twice; ends a countdown"),
    ("U", "redo it: discard it, and begin another; press twice"),
    ("Y / N", "label it a success / a failure; a running one ends and is kept"),
)
BUTTONS = ("A / B held 1 s", "with the deadman released: as E / as Z")
WORDS = {  # the row's parts: its state, a question, the counts
    "recording": "episode {number}: RECORDING {seconds} s",
    "countdown": "episode {number}: in {seconds} s",
    "idle": "episode {number}: not begun",
    "asked": "{armed}? once more within {within} s",
    "counts": "{kept} kept, {discarded} discarded",
}
KEYS_NOW = {  # as WORDS; after the last one was kept
    "recording": "E keep · Y success · N failure · Z discard · U redo",
    "countdown": "Z calls it off",
    "idle": "E begin",
    "kept": "E begin · Y / N label · Z discard · U redo",
}
ASKED_WITHIN_S = ARMED_NS // NS_PER_S
_SIGNS = {None: "●", True: "✔", False: "✖"}
_DISCARDED = "–"


def now_text(episodes: EpisodesState) -> str:
    """The running or next episode in a few words."""
    digits = 0 if episodes.doing == "recording" else 1
    text = WORDS.get(episodes.doing, WORDS["idle"])
    return text.format(number=episodes.number, seconds=f"{episodes.seconds:.{digits}f}")


def asked_text(episodes: EpisodesState) -> str:
    """The question that a second request answers, "" if there is none."""
    if not episodes.armed:
        return ""
    return WORDS["asked"].format(armed=episodes.armed.upper(), within=ASKED_WITHIN_S)


def keys_text(episodes: EpisodesState) -> str:
    """The keys that mean something now."""
    last_is_kept = bool(episodes.last) and episodes.last[-1].kept
    if episodes.doing in ("recording", "countdown"):
        return KEYS_NOW[episodes.doing]
    return KEYS_NOW["kept" if last_is_kept else "idle"]


def last_text(episodes: EpisodesState) -> str:
    """The last ones, the newest first: sign, number, verdict and length."""
    return "   ".join(map(_ended, reversed(episodes.last)))


def counts_text(episodes: EpisodesState) -> str:
    """How many there are of those that have ended."""
    return WORDS["counts"].format(kept=episodes.kept, discarded=episodes.discarded)


def strip_texts(episodes: EpisodesState, is_replay: bool, is_over: bool) -> tuple[str, ...]:
    """The parts of the window's row: now, asked, keys, last, counts; "" for what is not there."""
    has_keys = not (is_replay or is_over or episodes.armed)
    return (
        "" if is_over else now_text(episodes),
        "" if is_over else asked_text(episodes),
        keys_text(episodes) if has_keys else "",
        last_text(episodes),
        counts_text(episodes),
    )


def line(episodes: EpisodesState) -> str:
    """All of it in one line; what matters most comes first."""
    last = episodes.last[-1:]
    parts = [now_text(episodes), asked_text(episodes), counts_text(episodes)]
    parts += [f"last: {one.number} {verdict(one)}" for one in last]
    return " · ".join(filter(None, parts))


def _ended(one: EpisodeState) -> str:
    sign = _SIGNS[one.success] if one.kept else _DISCARDED
    word = verdict(one).removeprefix("kept, ")  # there is room for few words
    return f"{sign} {one.number} {word} {one.length_s:.0f} s"
