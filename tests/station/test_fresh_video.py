"""Which frame the age of the video counts from: whole, and on a face that has worked since."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import ShownFrame, SteeredBy
from tams_app.station.fresh_video import Displays, FreshVideo
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

IMAGE = np.zeros((2, 2, 3), np.uint8)


def frame(index: int, shown_ms: int, whole: bool = True) -> ShownFrame:
    return ShownFrame("gt", index, shown_ms * NS_PER_MS, IMAGE, (shown_ms - 60) * NS_PER_MS, whole)


def counted(index: int, shown_ms: int, is_damaged: bool = False) -> SteeredBy:
    return SteeredBy(index, (shown_ms - 60) * NS_PER_MS, is_damaged)


def test_without_a_face_a_whole_frame_counts_at_once_and_nothing_before_the_first() -> None:
    video = FreshVideo(("gt", "gs"), Displays())
    assert video.of("gt") == SteeredBy()
    video.shown(frame(7, 100))
    assert video.of("gt") == counted(7, 100)
    assert video.of("gs") == SteeredBy()


def test_a_frame_that_is_not_whole_leaves_the_age_to_the_last_one_that_is() -> None:
    video = FreshVideo(("gt",), Displays())
    video.shown(frame(0, 100, whole=False))
    assert video.of("gt") == SteeredBy(is_damaged=True)
    video.shown(frame(1, 133))
    video.shown(frame(2, 166, whole=False))
    video.shown(frame(3, 200, whole=False))
    assert video.of("gt") == counted(1, 133, is_damaged=True)
    video.shown(frame(4, 233))
    assert video.of("gt") == counted(4, 233)


def test_on_a_window_that_stands_still_counts_what_was_there_before() -> None:
    displays, heard_ms = Displays(), 90
    video = FreshVideo(("gt",), displays)
    displays.add(lambda _view: heard_ms * NS_PER_MS)
    video.shown(frame(0, 80))
    video.shown(frame(1, 100))
    assert video.of("gt") == counted(0, 80)
    for index in range(2, 1000):  # it hangs for half a minute
        video.shown(frame(index, 100 + 33 * index, whole=index % 2 == 0))
    assert video.of("gt") == counted(0, 80), "and what came since is not even known as damaged"
    heard_ms = 40_000
    assert video.of("gt") == counted(998, 100 + 33 * 998, is_damaged=True)


@given(
    st.lists(
        st.tuples(st.sampled_from(["frame", "damaged", "beat", "other beat"]), st.integers(0, 400)),
        max_size=150,
    )
)
def test_no_frame_counts_that_is_newer_than_what_any_face_shows(
    steps: list[tuple[str, int]],
) -> None:
    displays, heard_ns = Displays(), {"beat": 0, "other beat": 0}
    video = FreshVideo(("gt",), displays)
    displays.add(lambda _view: heard_ns["beat"])
    displays.add(lambda _view: heard_ns["other beat"])
    now_ms, before, whole = 60, -1, {}
    for index, (what, wait_ms) in enumerate(steps):
        now_ms += wait_ms
        if what in heard_ns:
            heard_ns[what] = now_ms * NS_PER_MS
        else:
            video.shown(frame(index, now_ms, what == "frame"))
            if what == "frame":
                whole[index] = now_ms * NS_PER_MS
        found = video.of("gt")
        if found.index is not None:
            assert whole[found.index] <= min(heard_ns.values())
            assert found.index >= before, "it never goes back"
            before = found.index
    if max(heard_ns.values()) >= NS_PER_S:
        heard_ns |= dict.fromkeys(heard_ns, now_ms * NS_PER_MS)
        assert video.of("gt").index == max(whole, default=None)
