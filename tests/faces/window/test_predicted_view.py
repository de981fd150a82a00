"""The real window with a camera on the arm: its frame is drawn as it would look now."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tams_app.records import Pose
from tests.faces.window.conftest import ShownWindow, shown_window
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.feeding import ELSEWHERE, LENS, THERE, ArmElsewhere
from tests.faces.window.photographs import SAME, difference
from tests.faces.window.xvfb import virtual_screen, wait_for
from tests.prediction.wrist import picture

# a window takes keys only while it was painted within 150 ms
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

Shown = tuple[ShownWindow, ArmElsewhere]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shown]:
    folder: Path = tmp_path_factory.mktemp("predicted")
    arm = ArmElsewhere()
    with (
        pytest.MonkeyPatch.context() as patch,
        virtual_screen(folder, patch) as screen,
        shown_window(folder, screen, arm=arm) as window,
        arm.running(),
    ):
        window.show(changed(FACTS, t_s=time.monotonic()))
        yield window, arm


def sees(window: ShownWindow, flange: Pose) -> bool:
    """Whether the middle of the wrist view looks as from there."""
    return difference(window.screen.photograph(), "eih", picture(LENS, flange)) < SAME


def test_the_frame_follows_where_the_arm_is_believed_to_be_without_a_new_one(shown: Shown) -> None:
    window, arm = shown
    for now, other in ((THERE, ELSEWHERE), (ELSEWHERE, THERE), (THERE, ELSEWHERE)):
        arm.now = now
        assert wait_for(lambda: sees(window, arm.now))
        assert not sees(window, other)


def test_f2_shows_the_frame_as_received_and_predicted_again(shown: Shown) -> None:
    window, arm = shown
    arm.now = ELSEWHERE
    assert wait_for(lambda: sees(window, ELSEWHERE))
    for flange in (THERE, ELSEWHERE):
        window.key("F2")
        assert wait_for(lambda: sees(window, flange))  # noqa: B023


def test_a_frame_that_has_grown_old_is_shown_as_received(shown: Shown) -> None:
    window, arm = shown
    arm.now = ELSEWHERE
    for shows_frames, flange in ((True, ELSEWHERE), (False, THERE), (True, ELSEWHERE)):
        arm.shows_frames = shows_frames
        assert wait_for(lambda: sees(window, flange))  # noqa: B023
