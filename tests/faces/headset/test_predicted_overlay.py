"""The real headset's process with a camera on the arm: what SteamVR gets of a corrected view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from tams_app import palette
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.headset.layout import BORDER_PX, HEADER_PX, Atlas
from tams_app.faces.headset.painting import ViewCell
from tams_app.faces.shown import is_old, view_title
from tams_app.prediction.plane_warp import WristWarp
from tams_app.records import Image, Pose
from tests.faces.headset.conftest import WornHeadset, worn_headset
from tests.faces.window.facts import FACTS, OPENING, changed
from tests.faces.window.feeding import ELSEWHERE, LENS, RECEIVED, THERE, ArmElsewhere
from tests.faces.window.xvfb import wait_for
from tests.prediction.wrist import above

pytestmark = pytest.mark.waiting

FRONT = "tams.view 0"
VIEW = FACTS.state.primary_view


@dataclass
class Session:
    """A headset, and an arm whose frames it shows."""

    headset: WornHeadset
    arm: ArmElsewhere

    def tell(self, age_ms: float) -> None:
        """The age of what was received of the view."""
        views = dict(FACTS.state.views)
        views[VIEW] = msgspec.structs.replace(views[VIEW], age_ms=age_ms)
        self.headset.show(changed(FACTS, views=views))

    def has(self, frame: Image, words: str, age_ms: float) -> bool:
        """Whether the overlay in front has exactly this frame, and says this age and these words.

        Around it are the stripes of an old frame if that is its age.
        """
        seen = self.headset.steamvr.seen(FRONT)
        if seen.size == 0:
            return False
        inner = seen[HEADER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
        expected = expected_cell(words, age_ms)
        return np.array_equal(inner, frame) and all(
            np.array_equal(seen[part], expected[part])
            for part in (slice(HEADER_PX), slice(-BORDER_PX, None))
        )

    def comes_to_have(self, frame: Image, words: str, age_ms: float) -> bool:
        """Whether it has so at some moment: on a busy machine beliefs are missing now and then."""
        met = False

        def look() -> bool:
            nonlocal met
            met = met or self.has(frame, words, age_ms)
            return met

        return wait_for(look)


def expected_cell(words: str, age_ms: float) -> Image:
    """A cell of the primary view with its title, BGR."""
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    atlas = Atlas(config.video.views, config.video.width, config.video.height)
    cell = ViewCell(atlas, palette.view_colour(config.video.views.index(VIEW)))
    view = msgspec.structs.replace(FACTS.state.views[VIEW], age_ms=age_ms)
    state = changed(FACTS, views={VIEW: view}).state
    cell.set_title(view_title(VIEW, state, OPENING) + words, is_old(view, OPENING.old_ms))
    return cell.pixels[..., 2::-1]


def predicted(now: Pose) -> Image:
    warped = WristWarp(LENS, ()).to_now(RECEIVED, THERE, now)
    assert warped is not None
    return warped


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    arm = ArmElsewhere()
    arm.now = ELSEWHERE
    with worn_headset(tmp_path_factory.mktemp("predicted"), arm) as headset, arm.running():
        yield Session(headset, arm)


def test_the_overlay_has_the_frame_as_it_would_look_now_and_says_so(session: Session) -> None:
    session.tell(120.0)
    for now in (ELSEWHERE, above(-0.01, 0.01, 0.2), ELSEWHERE):
        session.arm.now = now
        assert session.comes_to_have(predicted(now), " · predicted", 120.0)


def test_a_predicted_frame_is_as_old_as_what_was_received(session: Session) -> None:
    session.tell(1240.0)
    assert session.comes_to_have(predicted(ELSEWHERE), " · predicted", 1240.0)
    assert not session.has(predicted(ELSEWHERE), " · predicted", 120.0)
