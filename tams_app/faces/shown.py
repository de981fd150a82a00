"""What is shown of a session at one moment, in words, for every face; pure.

`shown_of` is all of it as one record, of which a face draws what it has room for.
"""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.faces import episodes
from tams_app.faces.banner import Banner, Look, banner_of
from tams_app.faces.commands import PHASE_KEYS
from tams_app.faces.messages import FaceFacts, Opening, ReplayFacts, Stretch, TrialFacts
from tams_app.printing import known
from tams_app.records import Phase, SessionState, ViewState
from tams_app.teleop.hands import words_of_hand
from tams_app.video.core.stages import REMEDIES, stage_words

MEANINGS = {"eih": "eye-in-hand", "gt": "global top", "gs": "global side"}
NOTABLE_MS = 25  # outside the network: below it there is little to gain
# A headset hides the keyboard, so the button that confirms comes first.
_KEYS_OF_BUTTONS = {
    "disarmed": "{release}, hold {confirm} 1 s (or press Enter) to arm",
    "ready": "Press and hold {deadman} to move it",
    "engaged": "{release} to stop · click {confirm}: emergency stop",
    "holding": "{release} · click {confirm}: emergency stop",
    "fault": "{release}, hold {confirm} 1 s to clear, again to arm",
    "link lost": "{release} and wait for the link",
}
UPLINK = (
    "views {sent} of budget {budget} kbit/s; with padding, RTCP {link}",
    "capacity {capacity}, estimated {estimate}; queue {queue} ms, loss {loss} %",
)
SLOWEST = "{view} {total} ms besides the network{upto} ({stage} {ms}): {remedy}"
TO_THE_UPLINK, OTHER_REMEDY = " to the uplink", "use fewer frames"
TITLES = {
    "primary": " · primary",
    "pinned by": " · pinned by the operator",
    "pinned": " · pinned",
    "none": " · no frame yet",
    "old": " · OLD: {seconds} s",
}
HAND = {
    "deadman": ("not known", "released", "HELD"),  # not known, no, yes
    "mode": ("", "translation", "orientation"),
    "gripper": ("not known", "open", "closed"),
    "buttons": ("none",),
    "TCP": ("not known",),
    "motors": ("not known",),
}
HOTTEST = "to {hottest} °C"
HEADINGS = ("view", "kbit/s: sent / target", "frames/s", "latency", "age", "SSIM now / task")


@dataclass(frozen=True, slots=True)
class PanelWords:
    """What is below the primary view in a headset: state, phase, why, what helps, and a note."""

    look: Look
    phase: str
    sentence: str
    key: str
    note: str  # a trial's time, the episodes, or the notices last


@dataclass(frozen=True, slots=True)
class ShownState:
    """A session at one moment, as it is written; but for the titles of views (`view_title`).

    rows: by view, the cells below HEADINGS. uplink: its lines, and what makes the primary view
    late. hand: name and word of each row. card: of a trial, or for who marks phases. position: of a
    replay, and how it goes. marks: see `ReplayFacts`. episodes: the parts of their row, () where
    there are none.
    """

    state: SessionState
    banner: Banner
    panel: PanelWords
    notice: str
    status: str
    placed: str
    rows: tuple[tuple[str, ...], ...]
    uplink: tuple[str, ...]
    hand: tuple[tuple[str, str], ...]
    card: tuple[str, ...]
    position: tuple[str, ...]
    marks: tuple[Stretch, ...] | None
    episodes: tuple[str, ...]


def shown_of(facts: FaceFacts, opening: Opening, shift_is_dead: bool = False) -> ShownState:
    """All that is shown of these facts. shift_is_dead: `Keyboard.shift_is_dead`."""
    state, replay, is_over = facts.state, facts.replay, facts.end is not None
    banner = banner_of(facts, opening.hand, shift_is_dead)
    card: tuple[str, ...] = ()
    if facts.trial is not None:
        card = trial_texts(facts.trial)
    elif replay is not None and opening.blind:
        card = marking_texts(state.phase)
    position: tuple[str, ...] = ()
    if opening.replay is not None and replay is not None:
        position = replay_texts(state.t_s, opening.replay.end_s, replay)
    row: tuple[str, ...] = ()
    if state.episodes is not None:
        row = episodes.strip_texts(state.episodes, replay is not None, is_over)
    views = [(view, state.views.get(view, ViewState())) for view in opening.views]
    return ShownState(
        state=state,
        banner=banner,
        panel=_panel_words(facts, banner, opening.hand),
        # of a session that is over it says what holds no longer
        notice=facts.notices[-1].text if facts.notices and not is_over else "",
        status=_status_text(facts, opening),
        placed=_placed_text(opening) if state.placed and not is_over else "",
        rows=tuple(view_row(view, one, state.asked_fps) for view, one in views),
        uplink=(*uplink_texts(state), slowest_text(state)),
        hand=hand_rows(state),
        card=card,
        position=position,
        marks=None if replay is None else replay.marks,
        episodes=row,
    )


def _panel_words(facts: FaceFacts, banner: Banner, hand: str) -> PanelWords:
    words, state = words_of_hand(hand), facts.state
    confirms = words.confirm and state.arming in _KEYS_OF_BUTTONS
    key = words.fill(_KEYS_OF_BUTTONS[state.arming]) if confirms else banner.key
    if facts.trial is not None:
        note = " · ".join(trial_texts(facts.trial)[:3])
    elif state.episodes is not None:
        note = episodes.line(state.episodes)
    else:
        note = facts.notices[-1].text if facts.notices else ""
    return PanelWords(banner.look, state.phase, banner.sentence, key, note)


def _status_text(facts: FaceFacts, opening: Opening) -> str:
    """Time, strategy, network and recording; of a replay, whose bar has its time, without both."""
    parts = []
    if opening.strategy:
        parts.append(f"strategy {opening.strategy}, network {opening.network.rpartition('/')[2]}")
    if opening.replay is None and facts.end is None:
        parts.insert(0, f"{minutes(facts.state.t_s)} elapsed")
        parts.append(f"recording{_size(facts)}")
    return " · ".join(parts)


def _size(facts: FaceFacts) -> str:
    if facts.recorded_mb is None:
        return ""
    a_minute = facts.recorded_mb * 60 / max(facts.state.t_s, 1.0)
    return f": {facts.recorded_mb:.0f} MB, {a_minute:.0f} MB a minute"


def _placed_text(opening: Opening) -> str:
    """The notice over the primary view once the block is placed."""
    if opening.replay is not None or opening.blind or opening.has_episodes:
        return "✔ The block is placed"
    return "✔ The block is placed · Q ends the session, or go on"


def view_row(name: str, view: ViewState, asked_fps: float | None) -> tuple[str, ...]:
    """The cells below HEADINGS."""
    return (
        name.upper(),
        f"{known(view.sent_kbps)} / {known(view.target_kbps)}",
        f"{known(view.fps)} / {known(asked_fps)}",
        f"{known(view.latency_ms)} ms",
        f"{known(view.age_ms)} ms",
        ""
        if view.live_ssim is None
        else f"{view.live_ssim:.2f} / {known(view.task_live_ssim, '{:.2f}')}",
    )


def uplink_texts(state: SessionState) -> tuple[str, str]:
    """The uplink's load and condition: views alone share the budget, and vary within a second."""
    loss = "–" if state.loss is None else f"{100 * state.loss:.1f}"
    sent = [view.sent_kbps for view in state.views.values() if view.sent_kbps is not None]
    figures = {
        "sent": known(sum(sent) if sent else None),
        "budget": known(state.budget_kbps),
        "link": known(state.link_kbps),
        "capacity": known(state.capacity_kbps),
        "estimate": known(state.estimate_kbps),
        "queue": known(state.queue_ms),
        "loss": loss,
    }
    load, condition = (one.format_map(figures) for one in UPLINK)
    return load, condition


def slowest_text(state: SessionState) -> str:
    """The primary view's latency besides the network, and the remedy; "" where it is low.

    On the robot's side it ends where the packets leave.
    """
    view = state.views.get(state.primary_view, ViewState())
    own = view.own
    if own is None or own.total_ms < NOTABLE_MS:
        return ""
    return SLOWEST.format(
        view=state.primary_view.upper(),
        total=own.total_ms,
        upto=TO_THE_UPLINK if view.shown_fps is None else "",
        stage=stage_words(own.slowest),
        ms=own.slowest_ms,
        remedy=REMEDIES.get(own.slowest, OTHER_REMEDY),
    )


def hand_rows(state: SessionState) -> tuple[tuple[str, str], ...]:
    """The state of the operator's hand: name and word."""
    hottest = HAND["motors"][0]
    if state.hottest_motor_c is not None:
        hottest = HOTTEST.format(hottest=state.hottest_motor_c)
    return (
        ("deadman", _answer("deadman", state.deadman)),
        ("mode", _answer("mode", state.orientation_mode)),
        ("gripper", _answer("gripper", state.gripper_closed)),
        ("buttons", ", ".join(state.pressed) or HAND["buttons"][0]),
        ("TCP", _tcp(state.tcp_mm)),
        ("motors", hottest),
    )


def _answer(row: str, is_so: bool | None) -> str:
    return HAND[row][0 if is_so is None else 1 + is_so]


def trial_texts(trial: TrialFacts) -> tuple[str, ...]:
    """Participant and title of a trial, and its time so far."""
    limit = minutes(trial.limit_s)
    if trial.passed_s is None:
        time = f"Not begun: it begins when the arm first follows. {limit} allowed"
    elif trial.passed_s < trial.limit_s:
        time = f"{minutes(trial.passed_s)} of {limit}"
    else:
        time = f"The time is over ({limit}): Q ends the trial"
    drops = f"Drops: {trial.drops} (X: more, Backspace: less)"
    return trial.participant, trial.title, time, drops, "P ends it when the block is placed"


def marking_texts(phase: str) -> tuple[str, ...]:
    """The phase marked at the moment shown, and the keys; as many as `trial_texts`."""
    keys = [f"{key} {one}" for key, one in PHASE_KEYS.items() if one is not None]
    return (
        phase if phase in list(Phase) else "no phase",
        " · ".join(keys[:3]),
        " · ".join(keys[3:]),
        "0 no phase · Backspace: undo",
        "Page Up, Page Down: 0.1 s · F1: all keys",
    )


def minutes(t_s: float) -> str:
    """Seconds as minutes and seconds."""
    whole_minutes, seconds = divmod(int(t_s), 60)
    return f"{whole_minutes}:{seconds:02}"


def replay_texts(t_s: float, end_s: float, replay: ReplayFacts) -> tuple[str, str]:
    """Position of a replay in a log of `end_s`, speed and pause."""
    position, length = (f"{minutes(one)}.{int(10 * one) % 10}" for one in (t_s, end_s))
    state = ", at the end" if t_s >= end_s else ", paused" if replay.paused else ""
    return f"{position} / {length}", f"×{replay.speed:g}{state}"


def is_old(view: ViewState | None, old_ms: float) -> bool:
    """True if the view's frame has this age [ms] or more (`teleop` watches the age itself)."""
    return view is not None and view.age_ms is not None and view.age_ms >= old_ms


def view_title(
    name: str, state: SessionState | None, opening: Opening, pinned: bool | None = None
) -> str:
    """The text in a view's picture: its name, and if its frame is old, that.

    pinned: whether it is, in a window, which has room for what the name means; else None.
    """
    view = None if state is None else state.views.get(name)
    title = name.upper()
    if state is not None and name == state.primary_view:
        title += TITLES["pinned by" if state.is_pinned else "primary"]
        pinned = pinned and not state.is_pinned
    title += TITLES["pinned"] if pinned else ""
    age_ms = None if view is None else view.age_ms
    if view is None or (age_ms is None and not opening.blind):
        return title + TITLES["none"]
    if age_ms is not None and is_old(view, opening.old_ms):
        return title + TITLES["old"].format(seconds=f"{age_ms / 1000:.1f}")
    if pinned is None or name not in MEANINGS:
        return title
    return title.replace(name.upper(), f"{name.upper()}, {MEANINGS[name]}", 1)


def _tcp(tcp_mm: tuple[float, float, float] | None) -> str:
    if tcp_mm is None:
        return HAND["TCP"][0]
    x, y, z = (round(part) for part in tcp_mm)  # whole numbers, of which 0 has no sign
    return f"{x}, {y}, {z} mm"
