"""The page in a browser against the product's own: words, messages, and the hand that keys move."""

from __future__ import annotations

import json
import subprocess
from base64 import b64decode, b64encode
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest

from hw.desk.keyboard import HeldKeys, Taps, VirtualHand, deflection_of
from tams_app.config import DEFAULT_CONFIG, load_config
from tams_app.faces import episodes
from tams_app.faces.banner import banner_of
from tams_app.faces.messages import FaceFacts, Opening, ShownWorkspace
from tams_app.faces.page_tables import page_tables
from tams_app.faces.shown import hand_rows, slowest_text, uplink_texts, view_row, view_title
from tams_app.faces.silence import LIVE_NS, as_known
from tams_app.link.messages import HandMessage, SessionDescription, StateMessage, decode, encode
from tams_app.records import LINK_LOST, EpisodesState, EpisodeState, SessionState, ViewState
from tams_app.records.state import LatencyState
from tams_app.teleop.hands import words_of_hand
from tams_app.teleop.reasons import Reason, what_to_do
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

HERE = Path(__file__).parent
CONFIG = load_config(DEFAULT_CONFIG)
TABLES = json.loads(json.dumps(page_tables(CONFIG)))
VIEWS = CONFIG.video.views
STOPPED_AFTER_MS = 500
SENT_NS = 2**60 + 1  # more than a number keeps in JavaScript
ARMINGS = ("disarmed", "ready", "engaged", "holding", "fault", "starting")
HANDS = ("keyboard", "gamepad")


def state_of(random: Random, number: int) -> SessionState:
    """Any state; each number has another arming and reason."""
    reasons = list(Reason)
    reason = reasons[number % len(reasons)].label
    details = ("", ": joint 3", ": a whole sentence.", ": confirm it.")
    lasting = random.choice((reason, "", None, reasons[number % 7].label))
    view = ViewState(
        target_kbps=random.choice((None, 812.25)),
        sent_kbps=random.choice((None, 799.75)),
        given_fps=29.0,
        latency_ms=random.choice((None, 61.25)),
        age_ms=random.choice((None, 82.2, 512.0, 2345.6)),
        shown_fps=random.choice((None, 30.0)),
        own=random.choice((None, LatencyState(31, "camera", 17), LatencyState(40, "new", 9))),
        live_ssim=random.choice((None, 0.953)),
        task_live_ssim=random.choice((None, 0.914)),
    )
    ended = (EpisodeState(1, 4.5, True, None), EpisodeState(2, 3.0, random.random() < 0.5))
    return SessionState(
        t_s=12.5,
        arming=ARMINGS[number % len(ARMINGS)],
        reason=random.choice(("", reason + random.choice(details))),
        lasting=lasting,
        last_stop=random.choice(("", "link gap")),
        deadman=random.choice((True, False, None)),
        orientation_mode=random.random() < 0.5,
        gripper_closed=random.choice((True, False, None)),
        pressed=random.choice(((), ("grip", "A"))),
        phase="ALIGN",
        primary_view=random.choice(VIEWS),
        is_pinned=random.random() < 0.3,
        tcp_mm=random.choice((None, (-0.2, 250.4, 99.9))),
        views=dict.fromkeys(VIEWS, view),
        link_kbps=random.choice((None, 1500.2)),
        queue_ms=random.choice((None, 4.2)),
        loss=random.choice((None, 0.0123)),
        asked_fps=30.0,
        heard_ns=SENT_NS,
        joints_urad=(-1, -40_000, 2**31, 7, 8, 9),
        hottest_motor_c=random.choice((None, 41)),
        episodes=random.choice((None, *(_episodes(doing, ended) for doing in _DOINGS))),
    )


_DOINGS = ("idle", "countdown", "recording")


def _episodes(doing: str, ended: tuple[EpisodeState, ...]) -> EpisodesState:
    armed = "discard" if doing == "idle" and ended[-1].kept else ""
    return EpisodesState(3, doing, 7.3, armed, 1, 1, ended)


def silent_ms_of(number: int) -> int:
    """For how long nothing was heard: live, not live, stopped."""
    return (0, 400, 900)[number % 5 % 3]


@cache
def states() -> tuple[SessionState, ...]:
    random = Random(1)
    return tuple(state_of(random, number) for number in range(240))


@cache
def hands() -> tuple[HandMessage, ...]:
    pose = (0.25, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    still = HandMessage(2**61, False, 1, 0, 0, "standby", None, 0, 0, 0, 0, False, False, False, ())
    held = HandMessage(
        *(5, False, SENT_NS, SENT_NS, 3, "ok", pose, 4, 5, 1.0, 0.5, True, False, True),
        *((None, 2**32 - 1, 0), 2, 9, 3, 4, (1, 2, 3, 4), "keyboard", (True, False, False)),
        *((1, 2, 3, 4, 300), 2),
    )
    return still, held


def description() -> SessionDescription:
    """A session with values of every kind in it."""
    return SessionDescription(
        5, "0.1.0", "abc", "folder", "tams", "lte", 7, True, False,
        CONFIG.video.model_dump(mode="json"), {"longest_wait_ms": 190.5}, CONFIG.hand.rotation,
        CONFIG.limits.model_dump(mode="json"), None, 500.0,
    )  # fmt: skip


def ticks() -> list[dict[str, Any]]:
    """Two seconds of keys: taps, held ones, opposite ones, the deadman let go, a gap."""
    random, found, keys, presses, ms = Random(2), [], {"shift"}, dict[str, int](), 1000.0
    for number in range(240):
        if number % 12 == 5:
            key = random.choice(("w", "s", "a", "d", "r", "f", "shift", "w", "a"))
            if key in keys:
                keys.discard(key)
            else:
                keys.add(key)
                presses[key] = presses.get(key, 0) + 1
        ms += 80 if number == 100 else 8
        found.append({"ms": ms, "keys": sorted(keys), "presses": dict(presses)})
    return found


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page makes of all of it."""
    given = {
        "tables": TABLES,
        "states": [
            {
                "message": b64encode(encode(message_of(state))).decode(),
                "hand": HANDS[number % 2],
                "shiftIsDead": number % 2 == 0 and number % 9 == 0,
                "silentMs": silent_ms_of(number),
            }
            for number, state in enumerate(states())
        ],
        "held": {"rotation": CONFIG.hand.rotation, "ticks": ticks()},
        "hands": [json.dumps(_in_json(one)) for one in hands()],
        "description": b64encode(encode(description())).decode(),
    }
    path = tmp_path_factory.mktemp("page") / "given.json"
    path.write_text(json.dumps(given))
    ran = subprocess.run(
        ["node", "told.js", str(path)], cwd=HERE, capture_output=True, text=True, check=True
    )
    found: dict[str, Any] = json.loads(ran.stdout)
    return found


def _in_json(message: HandMessage) -> dict[str, Any]:
    """Its stamps as text, which JavaScript's JSON would round."""
    fields = msgspec.structs.asdict(message)
    is_long = {key: key.endswith("_ns") or key == "operator" for key in fields}
    return {key: str(one) if is_long[key] else one for key, one in fields.items()}


def message_of(state: SessionState) -> StateMessage:
    return StateMessage(SENT_NS, 1, 2, state, (None, 5), 1, "limit", 2, 3, 4, ("a", "é"), "", False)


def test_states_are_read_as_they_were_sent(page: dict[str, Any]) -> None:
    assert page["told"][0]["decoded"] == _named(message_of(states()[0]))


def _named(value: Any) -> Any:
    """A record with its fields by name, as deep as it goes; what JSON would round as text."""
    if isinstance(value, msgspec.Struct):
        return {name: _named(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, dict):
        return {key: _named(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [_named(one) for one in value]
    return str(value) if value == SENT_NS else value


def test_samples_are_read_as_the_page_sent_them(page: dict[str, Any]) -> None:
    assert tuple(decode(b64decode(one), HandMessage) for one in page["encoded"]) == hands()


def test_the_description_of_a_session_is_read_as_it_was_sent(page: dict[str, Any]) -> None:
    assert page["session"] == json.loads(msgspec.json.encode(description()))


def test_state_reason_and_what_helps_are_the_windows(page: dict[str, Any]) -> None:
    for number, (state, told) in enumerate(zip(states(), page["told"], strict=True)):
        hand = HANDS[number % 2]
        silent_ms = silent_ms_of(number)
        arming = LINK_LOST if silent_ms > STOPPED_AFTER_MS else state.arming
        heard_ns = SENT_NS - silent_ms * NS_PER_MS
        shown = msgspec.structs.replace(state, arming=arming, heard_ns=heard_ns, hand=hand)
        advice = what_to_do(state.reason, state.lasting, words_of_hand(hand))
        facts = as_known(FaceFacts(shown, advice, reported_ns=SENT_NS), SENT_NS)
        dead = number % 2 == 0 and number % 9 == 0
        banner = banner_of(facts, hand, dead)
        assert told["banner"] == [banner.look.word, banner.sentence, banner.key]
        _same_figures(facts.state, hand, told)


def _same_figures(state: SessionState, hand: str, told: dict[str, Any]) -> None:
    assert told["hand"] == [list(row) for row in hand_rows(state)]
    assert told["uplink"] == [*uplink_texts(state), slowest_text(state)]
    rows = [view_row(name, view, state.asked_fps) for name, view in state.views.items()]
    assert told["rows"] == [list(row) for row in rows]
    nowhere = ShownWorkspace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)
    opening = Opening(VIEWS, 0, 0, nowhere, False, hand, CONFIG.freshness.video_slow_ms)
    titles = [view_title(name, state, opening, name == "gs") for name in VIEWS]
    assert told["titles"] == titles
    if state.episodes is None:
        assert told["episodes"] == ""
        return
    now, asked, keys, _, counts = episodes.strip_texts(state.episodes, False, False)
    assert told["episodes"] == " · ".join((now, asked or keys, counts))


def test_every_reason_and_every_state_was_compared() -> None:
    reasons = {state.reason.partition(": ")[0] for state in states()}
    assert reasons >= {reason.label for reason in Reason}
    assert {state.arming for state in states()} == set(ARMINGS)
    assert any(silent_ms_of(number) * NS_PER_MS > LIVE_NS for number in range(5))


def test_the_same_keys_move_the_hand_as_in_the_window(page: dict[str, Any]) -> None:
    desk = CONFIG.controller.desk
    taps, hand, poses = Taps(desk.speed_m_s), VirtualHand(desk, CONFIG.hand.rotation), []
    for tick in ticks():
        now_ns, keys = round(tick["ms"] * NS_PER_MS), frozenset(tick["keys"])
        amounts = taps.step(now_ns, HeldKeys(keys, True, now_ns, tick["presses"]))
        pose = hand.step(now_ns, deflection_of(keys, tick["presses"], amounts))
        poses.append([*pose.position.tolist(), *pose.rotation])
    assert np.ptp(poses, axis=0).max() > 0.02
    np.testing.assert_allclose(page["poses"], poses, atol=1e-12)
