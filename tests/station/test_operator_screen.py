"""What is on the screen before the simulated operator."""

from __future__ import annotations

import numpy as np
import pytest

from tams_app.prediction.present import AsReceived, Correction, Shown
from tams_app.records import Image
from tams_app.station.operator_process import on_screen

pytestmark = pytest.mark.untimed

RECEIVED, CORRECTED = np.zeros((2, 2, 3), np.uint8), np.ones((2, 2, 3), np.uint8)


@pytest.mark.parametrize("correction", list(Correction))
def test_frames_are_as_received_but_for_those_that_are_predicted(correction: Correction) -> None:
    """They look past an outline."""
    asked = []

    def show(image: Image, capture_ns: int, now_ns: int) -> Shown:
        asked.append((capture_ns, now_ns))
        return Shown(CORRECTED, correction)

    screen = on_screen({"eih": (3, RECEIVED), "gt": (4, RECEIVED)}, {"eih": show}, 9)
    is_predicted = correction is Correction.PREDICTED
    assert screen.images["eih"] is (CORRECTED if is_predicted else RECEIVED)
    assert screen.images["gt"] is RECEIVED
    assert screen.predicted == ({"eih"} if is_predicted else set())
    assert asked == [(3, 9)]


def test_a_view_that_cannot_be_corrected_is_not_titled_as_predicted() -> None:
    show = {"eih": lambda image, *_: Shown(image, as_received=AsReceived.OLD)}
    screen = on_screen({"eih": (3, RECEIVED)}, show, 9)
    assert screen.images["eih"] is RECEIVED
    assert screen.predicted == frozenset()


def test_before_its_first_frame_a_view_shows_nothing() -> None:
    screen = on_screen({"eih": None}, {"eih": lambda *_: pytest.fail("nothing to show")}, 9)
    assert screen.images == {"eih": None}
    assert screen.predicted == frozenset()
