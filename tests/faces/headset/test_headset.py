"""The real process over the faked function table: the pixels that SteamVR gets, and where."""

from __future__ import annotations

import time

import cv2
import msgspec
import numpy as np
import openvr
import pytest

from tams_app import palette
from tams_app.faces.banner import LOOKS
from tams_app.faces.headset.layout import BORDER_PX, HEADER_PX
from tams_app.faces.messages import FaceClosed, FaceFacts
from tams_app.records import Image
from tests.faces.headset.conftest import WornHeadset
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.photographs import is_colour
from tests.faces.window.xvfb import wait_for

pytestmark = pytest.mark.waiting

PLACES = ("tams.view 0", "tams.view 1", "tams.view 2")
PANEL = "tams.panel"


def share_of(image: Image, colour: str) -> float:
    return float(is_colour(image, colour).mean())


def frame_of(cell: Image) -> Image:
    """The part of a view's picture in which its frame is."""
    return cell[HEADER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]


def shows(headset: WornHeadset, place: str, frame: Image) -> bool:
    """Whether exactly this frame is seen there, upright."""
    return np.array_equal(frame_of(headset.steamvr.seen(place)), frame)


def all_are_shown(headset: WornHeadset, frames: dict[str, Image]) -> bool:
    """Whether every frame is seen in exactly one place."""
    seen = [frame_of(headset.steamvr.seen(place)) for place in PLACES]
    return all(sum(np.array_equal(one, frame) for one in seen) == 1 for frame in frames.values())


def tell(headset: WornHeadset, facts: FaceFacts) -> None:
    headset.show(changed(facts, t_s=time.monotonic()))


def has_in_front(headset: WornHeadset, facts: FaceFacts, frame: Image) -> bool:
    """Whether this frame is in front; the facts are told again as a session would.

    Views that have just exchanged their places stay for a moment, whatever is told.
    """
    tell(headset, facts)
    return shows(headset, PLACES[0], frame)


def settle(headset: WornHeadset) -> None:
    """Tell the usual facts, and wait until the process has gone through its loop with them."""
    tell(headset, FACTS)
    told = len(headset.events)
    assert wait_for(lambda: len(headset.events) >= told + 30)  # more than a drawing may wait


def panel(headset: WornHeadset) -> Image:
    return headset.steamvr.seen(PANEL)


def test_every_frame_is_seen_to_the_last_pixel_upright_and_in_its_colours(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    tell(headset, FACTS)
    negatives = {view: 255 - image for view, image in pictures.items()}
    flipped = {view: np.flipud(image).copy() for view, image in negatives.items()}
    for turned in (negatives, flipped):
        assert not all_are_shown(headset, turned)
        headset.put(turned)
        assert wait_for(lambda: all_are_shown(headset, turned))  # noqa: B023


def test_frames_are_told_to_be_gamma_encoded(headset: WornHeadset) -> None:
    assert {one.colour_space for one in headset.steamvr.overlays().values()} == {
        openvr.ColorSpace_Gamma
    }


@pytest.mark.parametrize("primary", ["gt", "gs", "eih"])
def test_the_primary_view_is_in_front_and_no_overlay_moves_or_vanishes(
    headset: WornHeadset, pictures: dict[str, Image], primary: str
) -> None:
    headset.put(pictures)
    assert wait_for(lambda: all_are_shown(headset, pictures))
    before = headset.steamvr.overlays()
    headset.steamvr.ask("take done")
    facts = changed(FACTS, primary_view=primary)
    assert wait_for(lambda: has_in_front(headset, facts, pictures[primary]))
    assert wait_for(lambda: all_are_shown(headset, pictures))
    done = {what for what, _ in headset.steamvr.ask("take done")}
    assert done <= {"setOverlayTexture", "setOverlayTextureBounds"}
    after = headset.steamvr.overlays()
    assert list(after) == list(before)
    for key, overlay in after.items():
        assert overlay.shown
        assert np.array_equal(overlay.transform, before[key].transform)
        assert overlay.width_m == before[key].width_m
    front = max(after.values(), key=lambda one: one.width_m if one.key != PANEL else 0)
    assert front.key == PLACES[0]


def test_views_that_exchange_their_places_are_never_seen_half(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    """An eye that looks at any moment of the exchange sees whole frames, and one in front."""
    headset.put(pictures)
    assert wait_for(lambda: all_are_shown(headset, pictures))
    frames = list(pictures.values())
    for primary in ("eih", "gs", "gt"):
        facts = changed(FACTS, primary_view=primary)
        deadline_s = time.monotonic() + 60.0
        while not has_in_front(headset, facts, pictures[primary]):
            assert time.monotonic() < deadline_s
            seen = frame_of(headset.steamvr.seen(PLACES[0]))
            assert any(np.array_equal(seen, frame) for frame in frames)


@pytest.mark.parametrize("arming", ["ready", "engaged", "holding", "fault"])
def test_the_panel_has_the_state_s_colour_and_word(headset: WornHeadset, arming: str) -> None:
    tell(headset, changed(FACTS, arming=arming))
    look = LOOKS[arming]
    assert wait_for(lambda: share_of(panel(headset)[:96], look.colour) > 0.5)
    assert share_of(panel(headset)[:96], look.ink) > 0.02


def test_another_phase_reason_or_message_changes_the_panel(headset: WornHeadset) -> None:
    facts = changed(FACTS, arming="holding", reason="workspace limit")
    band, words = slice(0, 96), slice(96, None)
    tell(headset, facts)
    assert wait_for(lambda: share_of(panel(headset)[band], LOOKS["holding"].colour) > 0.5)
    for other, rows in (
        (changed(facts, phase="ALIGN"), band),
        (changed(facts, reason="stale video"), words),
        (changed(facts, reason="stale video", advice="Wait for it."), words),
    ):
        before = panel(headset)
        tell(headset, other)
        assert wait_for(lambda: bool((panel(headset) != before)[rows].any()))  # noqa: B023


def test_a_headset_whose_session_is_silent_says_so_and_greys_its_views(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    headset.put(pictures)
    tell(headset, FACTS)
    assert wait_for(lambda: share_of(panel(headset)[:96], LOOKS["engaged"].colour) > 0.5)
    headset.pause()
    assert wait_for(lambda: share_of(panel(headset)[:96], LOOKS["not live"].colour) > 0.5)

    def is_grey() -> bool:
        return all(
            int(np.ptp(frame_of(headset.steamvr.seen(place)).astype(int), axis=2).max()) == 0
            for place in PLACES
        )

    assert wait_for(is_grey)
    tell(headset, FACTS)
    headset.put(pictures)
    assert wait_for(lambda: share_of(panel(headset)[:96], LOOKS["engaged"].colour) > 0.5)
    assert wait_for(lambda: not is_grey())


def test_an_old_frame_gets_a_striped_border_and_loses_it_with_the_next(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    old = dict(FACTS.state.views)
    old["gs"] = msgspec.structs.replace(old["gs"], age_ms=1240.0)
    headset.put(pictures)

    def striped() -> list[str]:
        """The views with yellow and black around them."""
        found = []
        for place in PLACES:
            cell = headset.steamvr.seen(place)
            edge = cell[HEADER_PX:, :BORDER_PX]
            if share_of(edge, palette.YELLOW) > 0.3:
                frame = frame_of(cell)
                found += [view for view, one in pictures.items() if np.array_equal(one, frame)]
        return found

    tell(headset, changed(FACTS, views=old))
    assert wait_for(lambda: striped() == ["gs"])
    tell(headset, FACTS)
    assert wait_for(lambda: striped() == [])


def test_only_the_view_with_a_new_frame_is_handed_over(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    headset.put(pictures)
    tell(headset, FACTS)
    assert wait_for(lambda: all_are_shown(headset, pictures))
    settle(headset)
    (place,) = [place for place in PLACES if shows(headset, place, pictures["gt"])]
    before = {key: one.submitted for key, one in headset.steamvr.overlays().items()}
    other = cv2.flip(pictures["gt"], 1)
    headset.put({"gt": np.asarray(other, np.uint8)})
    assert wait_for(lambda: shows(headset, place, other))
    after = {key: one.submitted for key, one in headset.steamvr.overlays().items()}
    assert {key for key in after if after[key] != before[key]} == {place}


def test_a_steamvr_that_refuses_the_overlays_on_the_way_is_told_and_nothing_more(
    headset: WornHeadset, pictures: dict[str, Image]
) -> None:
    """Last: nothing is shown from then on. A session fails by it (test_session_headset.py)."""
    headset.steamvr.ask("refuse", openvr.VROverlayError_RequestFailed)
    headset.put(pictures)

    def told() -> list[str]:
        return [event.why for event in headset.events if isinstance(event, FaceClosed)]

    assert wait_for(lambda: bool(told()))
    (why,) = told()
    assert why.endswith("the connection to SteamVR broke (OverlayError_RequestFailed)")
