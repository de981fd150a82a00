"""What the panel says, and that there is room for it."""

from __future__ import annotations

import cairo
import pytest
from msgspec.structs import replace

from tams_app.faces.banner import LOOKS
from tams_app.faces.headset.layout import PANEL_WIDTH_PX
from tams_app.faces.headset.painting import SENTENCE_LINES, wrapped
from tams_app.faces.messages import FaceFacts, Notice, TrialFacts
from tams_app.faces.session_face import facts_of
from tams_app.faces.shown import PanelWords, shown_of
from tams_app.records import EpisodesState
from tams_app.teleop.hands import HANDS
from tams_app.teleop.reasons import Reason, what_to_do
from tests.faces.played_session import STATE
from tests.faces.window.facts import FACTS, OPENING, changed

pytestmark = pytest.mark.untimed

ROOM = PANEL_WIDTH_PX - 48.0


def panel(facts: FaceFacts, hand: str = "openvr") -> PanelWords:
    return shown_of(facts, replace(OPENING, hand=hand)).panel


@pytest.fixture
def cr() -> cairo.Context[cairo.ImageSurface]:
    return cairo.Context(cairo.ImageSurface(cairo.FORMAT_ARGB32, 8, 8))


@pytest.mark.parametrize("arming", ["holding", "fault"])
@pytest.mark.parametrize("reason", list(Reason), ids=lambda reason: reason.name)
@pytest.mark.parametrize("lasts", [True, False], ids=["lasting", "left"])
@pytest.mark.parametrize("hand", HANDS)
def test_every_reason_has_room_with_what_to_do(
    cr, hand: str, lasts: bool, arming: str, reason: Reason
) -> None:
    advice = what_to_do(reason.label, reason.label if lasts else "", HANDS[hand])
    facts = changed(FACTS, arming=arming, reason=reason.label, advice=advice)
    words = panel(facts, hand)
    lines = wrapped(cr, words.sentence, ROOM, SENTENCE_LINES)
    assert " ".join(lines) == words.sentence
    assert reason.label in words.sentence.lower() or reason.label in words.sentence
    assert advice in words.sentence


@pytest.mark.parametrize("arming", [*LOOKS, "starting"])
@pytest.mark.parametrize("hand", HANDS)
def test_what_helps_has_room_in_every_state(cr, hand: str, arming: str) -> None:
    reason = "stale video" if arming in ("holding", "fault") else ""
    words = panel(changed(FACTS, arming=arming, reason=reason), hand)
    assert wrapped(cr, words.key, ROOM, 1, bold=True) == [words.key]


def test_what_does_not_fit_is_cut_with_an_ellipsis(cr) -> None:
    (line,) = wrapped(cr, "word " * 200, ROOM, 1)
    assert line.endswith(" …")
    assert cr.text_extents(line).x_advance <= ROOM
    assert len(wrapped(cr, "word " * 200, ROOM, 3)) == 3
    assert wrapped(cr, "", ROOM, 3) == []


def test_the_menu_button_is_named_for_hands_that_see_no_keyboard() -> None:
    for arming in ("disarmed", "fault", "engaged", "holding"):
        key = panel(changed(FACTS, arming=arming)).key
        assert "menu button" in key


def test_what_was_said_last_is_below_but_for_an_episode_that_begins() -> None:
    notices = (Notice(1.0, "the first"), Notice(2.0, "the last"))
    facts = changed(FACTS, notices=notices)
    assert panel(facts).note == "the last"
    facts = changed(facts, episodes=EpisodesState(1, "countdown", 2.04))
    assert panel(facts).note == "episode 1: in 2.0 s · 0 kept, 0 discarded"


def test_in_a_trial_it_tells_who_and_the_time() -> None:
    trial = TrialFacts("P01", "trial 2 of 9", 3.0, 120.0)
    facts = facts_of(STATE, (), trial)
    assert panel(facts).note == "P01 · trial 2 of 9 · 0:03 of 2:00"
