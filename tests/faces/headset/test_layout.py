"""Where views stand around the head, and where they lie in the atlas."""

from __future__ import annotations

from itertools import combinations, pairwise
from math import degrees

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import HeadsetConfig
from tams_app.faces.headset.layout import Atlas, Place, panel_place, view_places

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs", "top", "left")
configs = st.builds(
    HeadsetConfig,
    distance_m=st.floats(0.5, 10),
    width_deg=st.floats(10, 60),
    elevation_deg=st.floats(-20, 20),
)


def corner(place: Place, right: float, up: float, height_share: float) -> np.ndarray:
    """A point of the picture as the head sees it: (1, 1) is its upper right corner."""
    offset = (right * place.width_m / 2, up * place.width_m * height_share / 2, 0.0, 1.0)
    return (place.pose @ offset)[:3]


def right_deg(point: np.ndarray) -> float:
    return degrees(np.arctan2(point[0], -point[2]))


def width_deg(place: Place) -> float:
    """The angle between the middles of its left and right edges."""
    ends = [corner(place, side, 0, 0) for side in (-1, 1)]
    cosine = ends[0] @ ends[1] / np.linalg.norm(ends[0]) / np.linalg.norm(ends[1])
    return degrees(np.arccos(cosine))


@given(configs, st.integers(1, 5))
def test_all_are_as_far_as_configured_and_turned_towards_the_eyes(config, count) -> None:
    for place in (*view_places(config, count), panel_place(config, Atlas(VIEWS, 640, 480))):
        centre = place.pose[:3, 3]
        assert np.linalg.norm(centre) == pytest.approx(config.distance_m)
        towards = place.pose[:3, :3] @ (0.0, 0.0, 1.0)
        assert np.allclose(towards, -centre / config.distance_m)
        assert np.linalg.det(place.pose[:3, :3]) == pytest.approx(1.0)


@given(configs, st.integers(1, 3))
def test_the_primary_view_is_straight_ahead_and_the_widest_the_others_beside_it(
    config, count
) -> None:
    first, *others = view_places(config, count)
    assert width_deg(first) == pytest.approx(config.width_deg)
    assert first.pose[0, 3] == pytest.approx(0.0)
    assert degrees(np.arcsin(first.pose[1, 3] / config.distance_m)) == pytest.approx(
        config.elevation_deg
    )
    for number, other in enumerate(others):
        assert width_deg(other) == pytest.approx(0.6 * config.width_deg)
        sign = -1 if number % 2 else 1
        assert sign * right_deg(other.pose[:3, 3]) > config.width_deg / 2


@given(st.integers(2, 5))
def test_no_view_stands_before_another_by_default(count) -> None:
    spans = sorted(
        sorted(right_deg(corner(place, side, 0, 0)) for side in (-1, 1))
        for place in view_places(HeadsetConfig(), count)
    )
    assert all(left[1] < right[0] for left, right in pairwise(spans))


@given(configs)
def test_the_panel_is_below_the_primary_view(config) -> None:
    atlas = Atlas(VIEWS, 640, 480)
    cell, panel = atlas.cells["eih"], atlas.panel
    lower = corner(view_places(config, 1)[0], 0, -1, cell.height / cell.width)
    upper = corner(panel_place(config, atlas), 0, 1, panel.height / panel.width)

    def up_deg(point: np.ndarray) -> float:
        return degrees(np.arctan2(point[1], -point[2]))

    assert up_deg(upper) < up_deg(lower)
    assert up_deg(lower) - up_deg(upper) < 5.0


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (320, 240)])
@pytest.mark.parametrize("count", [1, 3, 5])
def test_the_parts_of_the_atlas_lie_apart_and_within_it(count, size) -> None:
    atlas = Atlas(VIEWS[:count], *size)
    parts = [*atlas.cells.values(), atlas.panel]
    for part in parts:
        assert part.left >= 0
        assert part.top >= 0
        assert part.left + part.width <= atlas.width
        assert part.top + part.height <= atlas.height
    for one, other in combinations(parts, 2):
        beside = one.left + one.width < other.left or other.left + other.width < one.left
        assert beside or one.top + one.height < other.top or other.top + other.height < one.top
    assert (atlas.frame.width, atlas.frame.height) == size
