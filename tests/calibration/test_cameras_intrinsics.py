"""A lens is found from views of the board, with its errors; poor views are refused."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.cameras.board import Board, BoardFinder, print_board
from calibration.cameras.coverage import Coverage
from calibration.cameras.intrinsics import fit_intrinsics
from calibration.cameras.plane import Lens, Placed
from calibration.cameras.simulated_person import next_pose
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed

BOARD = Board()
MATRIX = np.array([[562.0, 0.0, 327.0], [0.0, 559.0, 233.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.21, 0.08, 0.0012, -0.0008, 0.0])
TRUTH = dict(
    zip(
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
        (562.0, 559.0, 327.0, 233.0, -0.21, 0.08, 0.0012, -0.0008),
        strict=True,
    )
)
WIDTH_M, HEIGHT_M = (part / 1000 for part in BOARD.size_mm)
PX_PER_MM = 5.0


@pytest.fixture(scope="module")
def lens():
    return Lens(MATRIX, DISTORTION, 640, 480)


def seen(lens, place, seed=0, blur_px=0.7, noise=2.0):
    flat = BOARD.frame(PX_PER_MM)
    behind = np.full((480, 640, 3), 90, np.uint8)
    image = lens.window_on(place, PX_PER_MM * 1000, flat.shape[:2]).see(flat, behind)
    image = cv2.GaussianBlur(image, (0, 0), blur_px)
    random = np.random.default_rng(seed)
    return np.clip(image + random.normal(0, noise, image.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def views(lens):
    finder = BoardFinder(BOARD)
    found = [
        finder.find(seen(lens, next_pose(lens, WIDTH_M, HEIGHT_M, number), number))
        for number in range(24)
    ]
    return [view for view in found if view is not None]


def test_a_lens_with_distortion_is_recovered_within_its_stated_errors(views):
    found = fit_intrinsics(views, 640, 480)
    assert found.rms_px < 0.25
    for name, truth in TRUTH.items():
        assert abs(found.values[name] - truth) < 4 * found.errors[name] + 0.002 * abs(truth), name
    assert found.values["fx"] == pytest.approx(562, rel=0.004)
    assert found.values["cx"] == pytest.approx(327, abs=2.5)
    assert found.values["k1"] == pytest.approx(-0.21, abs=0.02)


def test_a_view_that_does_not_fit_is_left_out(views):
    bent = views[0].image_points.copy()
    bent[::2] += 9.0
    spoilt = [type(views[0])(views[0].object_points, bent), *views[1:]]
    found = fit_intrinsics(spoilt, 640, 480)
    assert found.left_out == 1
    assert found.values["fx"] == pytest.approx(562, rel=0.004)


def test_too_few_views_are_refused(views):
    with pytest.raises(ValueError, match="9 views of the board; show at least 10"):
        fit_intrinsics(views[:9], 640, 480)


def test_a_board_that_is_not_as_it_is_said_to_be_is_refused(views):
    random = np.random.default_rng(0)
    wavy = [
        type(view)(
            view.object_points,
            (view.image_points + random.normal(0, 4, view.image_points.shape)).astype(np.float32),
        )
        for view in views
    ]
    with pytest.raises(ValueError, match="px off the best lens; is the board flat"):
        fit_intrinsics(wavy, 640, 480)


def test_views_all_alike_are_not_taken_twice(views):
    coverage = Coverage(640, 480)
    assert coverage.offer(views[0]) == ""
    assert "too similar" in coverage.offer(views[0])
    assert len(coverage.views) == 1


def test_a_board_held_straight_is_asked_to_be_tilted(lens):
    finder, coverage = BoardFinder(BOARD), Coverage(640, 480)
    for x in (-0.11, 0.0, 0.11):
        for y in (-0.08, 0.0, 0.08):
            straight = Placed(np.array([x, y, 0.42]), Rotation.identity(), WIDTH_M, HEIGHT_M)
            coverage.offer(finder.find(seen(lens, straight)))
    assert coverage.share >= 0.8
    assert coverage.wanting() == "tilt the board: its left edge away from the camera"


def test_what_is_missing_is_named_until_nothing_is(views):
    coverage = Coverage(640, 480)
    assert coverage.wanting().startswith("hold the board to the")
    for view in views:
        coverage.offer(view)
    assert coverage.wanting() == ""


@pytest.mark.parametrize(
    ("direction", "axis"), [("left", 1), ("right", 1), ("top", 0), ("bottom", 0)]
)
def test_a_tilt_is_counted_for_the_edge_that_is_farther_away(lens, direction, axis):
    sign = {"left": 1, "right": -1, "top": -1, "bottom": 1}[direction]
    turn = np.zeros(3)
    turn[axis] = sign * np.radians(30)
    place = Placed(np.array([0, 0, 0.5]), Rotation.from_rotvec(turn), WIDTH_M, HEIGHT_M)
    edge = {"left": (0, 0.5), "right": (1, 0.5), "top": (0.5, 0), "bottom": (0.5, 1)}[direction]
    corner = (
        place.origin + place.axes[:, 0] * edge[0] * WIDTH_M + place.axes[:, 1] * edge[1] * HEIGHT_M
    )
    assert corner[2] > 0.5
    coverage = Coverage(640, 480)
    coverage.offer(BoardFinder(BOARD).find(seen(lens, place)))
    assert [name for name, count in coverage.tilted.items() if count] == [direction]


def test_the_printed_board_is_as_large_as_it_says_and_is_found_again(tmp_path):
    path = tmp_path / "board.png"
    print_board(BOARD, path)
    page = cv2.imread(str(path))
    mm_per_px = 297.0 / page.shape[1]
    view = BoardFinder(BOARD).find(page)
    assert view is not None
    assert len(view.object_points) == (BOARD.columns - 1) * (BOARD.rows - 1)
    on_board = view.object_points[:, 0, :2] * 1000
    on_page = view.image_points[:, 0] * mm_per_px
    scale = np.linalg.norm(on_page[-1] - on_page[0]) / np.linalg.norm(on_board[-1] - on_board[0])
    assert scale == pytest.approx(1.0, abs=0.002)


def test_a_board_prints_to_pdf_of_one_a4_page(tmp_path):
    path = tmp_path / "board.pdf"
    print_board(BOARD, path)
    text = path.read_bytes()
    assert text.startswith(b"%PDF")
    assert b"/MediaBox [ 0 0 841.88976" in text


@pytest.mark.parametrize(("name", "square_mm"), [("board.jpg", 28.0), ("board.png", 60.0)])
def test_a_board_that_cannot_be_printed_is_one_sentence(tmp_path, name, square_mm):
    with pytest.raises(ConfigError):
        print_board(Board(square_mm=square_mm), tmp_path / name)
    assert not (tmp_path / name).exists()
