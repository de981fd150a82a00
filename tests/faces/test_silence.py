"""What is shown once nothing is received any more, by one rule for all displays."""

from __future__ import annotations

import io

import cairo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tams_app.faces.banner import banner_of
from tams_app.faces.headset.layout import PANEL_WIDTH_PX
from tams_app.faces.headset.painting import SENTENCE_LINES, wrapped
from tams_app.faces.messages import FaceFacts, ReplayFacts
from tams_app.faces.shown import hand_rows, shown_of, view_row, view_title
from tams_app.faces.silence import LIVE_NS, NOT_LIVE, as_known, silent_s
from tams_app.faces.terminal.line import StatusLine
from tams_app.printing import Console
from tams_app.teleop.hands import HANDS
from tams_app.units import NS_PER_S
from tests.faces.played_session import STATE
from tests.faces.window.facts import FACTS, OPENING, changed

pytestmark = pytest.mark.untimed

PUT = changed(FACTS, reported_ns=NS_PER_S, heard_ns=NS_PER_S)


def after(facts: FaceFacts, silence_s: float) -> FaceFacts:
    return as_known(facts, facts.reported_ns + round(silence_s * NS_PER_S))


@given(
    reported_ns=st.integers(0, 1 << 60),
    heard_ns=st.none() | st.integers(1, 1 << 60),
    now_ns=st.integers(0, 1 << 60),
)
def test_facts_are_live_for_three_tenths_of_a_second_and_no_longer(
    reported_ns: int, heard_ns: int | None, now_ns: int
) -> None:
    facts = changed(FACTS, reported_ns=reported_ns, heard_ns=heard_ns)
    known = as_known(facts, now_ns)
    oldest_ns = reported_ns if heard_ns is None else min(reported_ns, heard_ns)
    assert (known is facts) == (now_ns - oldest_ns <= LIVE_NS)
    assert (known.state.arming == NOT_LIVE) == (known is not facts)


def test_nothing_that_only_a_live_session_can_say_is_said_any_more() -> None:
    known = after(PUT, 4.0)
    banner = banner_of(known, "keyboard")
    assert banner.look.word == "NOT LIVE"
    assert "for 4.0 s" in banner.sentence
    assert "emergency stop button on the arm's control box" in banner.key
    assert dict(hand_rows(known.state))["deadman"] == "not known"
    assert dict(hand_rows(known.state))["buttons"] == "none"
    assert dict(hand_rows(after(PUT, 0.2).state))["deadman"] == "HELD"


def test_ages_grow_while_nothing_comes() -> None:
    known = after(PUT, 4.0)
    assert view_row("eih", known.state.views["eih"], 30)[4] == "4095 ms"
    assert "OLD: 4.1 s" in view_title("eih", known.state, OPENING)


@pytest.mark.parametrize("hand", HANDS)
def test_the_headset_says_the_same(hand: str) -> None:
    words = shown_of(after(PUT, 0.8), replace(OPENING, hand=hand)).panel
    assert words.look.word == "NOT LIVE"
    assert "for 0.8 s" in words.sentence
    assert "control box" in words.key


def test_a_session_that_works_may_still_hear_nothing_of_the_arm() -> None:
    silent = changed(PUT, reported_ns=3 * NS_PER_S)
    assert banner_of(as_known(silent, 3 * NS_PER_S)).look.word == "NOT LIVE"
    lost = changed(silent, arming="link lost")
    banner = banner_of(as_known(lost, 3 * NS_PER_S))
    assert banner.look.word == "LINK LOST"
    assert "for 2.0 s" in banner.sentence
    assert "button on the arm's control box still stops it" in banner.sentence
    assert banner_of(as_known(lost, 4 * NS_PER_S)).look.word == "NOT LIVE", "it is silent, too"


def test_a_replay_is_never_called_not_live() -> None:
    replay = changed(PUT, replay=ReplayFacts(1.0, True))
    assert as_known(replay, 1 << 60) is replay


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_terminal_says_so_too(is_terminal: bool) -> None:
    now_ns = 10 * NS_PER_S
    silent = replace(STATE, arming="engaged", now_ns=now_ns, heard_ns=now_ns - 2 * NS_PER_S)
    output = io.StringIO()
    with StatusLine(Console(file=output, width=200, force_terminal=is_terminal)) as line:
        line.update(silent)
    for told in ("NOT LIVE for 2.0 s", "emergency stop button on the arm's control box"):
        assert told in output.getvalue()
    for not_live in ("ENGAGED", "held", "stale video", "kbit/s"):
        assert is_terminal is False or not_live not in output.getvalue()


def test_what_was_never_heard_is_not_silent() -> None:
    assert silent_s(None, 1 << 60) is None


def test_what_still_stops_the_arm_has_room_in_the_headset() -> None:
    context = cairo.Context(cairo.ImageSurface(cairo.FORMAT_ARGB32, 8, 8))
    key = shown_of(after(PUT, 123.4), OPENING).panel.key
    assert wrapped(context, key, PANEL_WIDTH_PX - 48.0, 1, bold=True) == [key]
    lost = changed(PUT, arming="link lost", reported_ns=124 * NS_PER_S)
    words = shown_of(as_known(lost, 124 * NS_PER_S), OPENING).panel
    assert "control box still stops it" in words.sentence
    assert " ".join(wrapped(context, words.sentence, PANEL_WIDTH_PX - 48.0, SENTENCE_LINES)) == (
        words.sentence
    )
