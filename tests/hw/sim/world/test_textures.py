from __future__ import annotations

import cv2
import numpy as np
import pytest

from hw.sim.world import textures

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize(
    "paint", [textures.wood, textures.brick, textures.concrete, textures.brushed, textures.card,
              textures.label],
)  # fmt: skip
def test_surfaces_repeat_with_their_seed_and_have_detail(paint) -> None:  # type: ignore[no-untyped-def]
    first, second, other = (paint(np.random.default_rng(seed), 256, 128) for seed in (1, 1, 2))
    assert first.shape == (256, 128, 3)
    assert first.dtype == np.uint8
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)
    assert first.std() > 5


def test_marker_is_found_by_its_number() -> None:
    face = textures.marker(np.random.default_rng(0), 128, 128, 7, (10, 20, 90), (250, 220, 120))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    _, identities, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(face)
    assert identities.ravel().tolist() == [7]


def test_mat_has_its_four_markers_and_the_size_that_was_asked_for() -> None:
    mat = textures.work_mat(np.random.default_rng(0), 512, 1024, (0.46, 0.68))
    assert mat.shape == (512, 1024, 3)
    square = cv2.resize(mat, (1024, round(1024 * 0.46 / 0.68)))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    _, identities, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(square)
    assert sorted(identities.ravel().tolist()) == [10, 11, 12, 13]
