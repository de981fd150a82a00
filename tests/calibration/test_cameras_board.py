"""The board: where its corners are found, which of its views are taken, how it is printed."""

import re
import zlib
from dataclasses import replace

import cairo
import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.cameras import board as printed
from calibration.cameras.board import COLUMNS, ROWS, SQUARE_MM, Board, BoardPainter, board_pose
from calibration.cameras.watching import WANTED_VIEWS, Still, ViewTaker
from tams_app import cli
from tests.calibration.board_views import LENS, held, shown

pytestmark = pytest.mark.untimed

BOARD = Board()
GREY = np.full((480, 640, 3), 110, np.uint8)
STRAIGHT = replace(LENS, distortion=(0.0,) * 5)


def picture(lens=LENS, column=0.5, row=0.5, turn=(0.2, -0.3, 0.1)):
    return BoardPainter(lens, STRAIGHT).paint(GREY, BOARD, held(lens, column, row, turn))


@pytest.mark.parametrize("lens", [STRAIGHT, LENS])
def test_corners_are_found_where_the_lens_has_them(lens):
    pose = held(lens, 0.5, 0.5, (0.2, -0.3, 0.1))
    view = BOARD.find(picture(lens))
    assert view is not None
    assert len(view.ids) >= 20
    seen = pose.position + pose.rotation.apply(view.points)
    off = lens.pixels(seen[:, :2] / seen[:, 2:]) - view.pixels
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.15  # each within a few tenths
    assert np.abs(off.mean(axis=0)).max() < 0.1
    found = board_pose(view, lens.matrix(), np.array(lens.distortion))
    assert found.position == pytest.approx(pose.position, abs=0.001)
    assert (found.rotation.inv() * pose.rotation).magnitude() < 0.005


def test_a_part_of_the_board_will_do_and_too_small_a_part_will_not():
    part = BOARD.find(picture(column=0.12, row=0.5, turn=(0.0, 0.0, 0.0)))
    assert part is not None
    assert 8 <= len(part.ids) < 24
    assert BOARD.find(picture(column=-0.1, row=-0.1, turn=(0.0, 0.0, 0.0))) is None
    assert BOARD.find(GREY) is None


def test_markers_that_lie_about_do_not_spoil_it():
    """A second marker of the same number would: the numbers that most people print are low."""
    image = picture()
    numbered = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number in range(12):
        marker = cv2.copyMakeBorder(
            cv2.aruco.generateImageMarker(numbered, number, 36), 6, 6, 6, 6,
            cv2.BORDER_CONSTANT, value=255,
        )  # fmt: skip
        image[430:478, 2 + 50 * number : 50 + 50 * number] = marker[..., None]
    view = BOARD.find(image)
    assert view is not None
    assert len(view.ids) >= 12


def test_the_length_of_a_square_scales_the_board():
    points = Board(30.0).corners
    assert points == pytest.approx(BOARD.corners * 30.0 / SQUARE_MM)


def test_a_view_counts_once_it_holds_still_and_once_only():
    first, second = shown(LENS, 2, 0)
    taker = ViewTaker(640, 480)
    said = [taker.offer(view) for view in (None, first, first, first, second, second)]
    assert said == ["no board", "hold still", "taken", "taken; now another side", "hold still",
                    "taken"]  # fmt: skip
    assert len(taker.views) == 2


def test_a_board_that_moves_or_was_not_seen_before_does_not_hold_still():
    (view,) = shown(LENS, 1, 0)
    still = Still(640)
    assert [still.holds(one) for one in (view, replace(view, pixels=view.pixels + 0.9))] == [
        False,
        False,
    ]  # 0.9 px in both directions: 1.3
    assert still.holds(replace(view, pixels=view.pixels + 1.2))
    assert not still.holds(None)
    assert not still.holds(view)
    wide = Still(1280)
    assert [wide.holds(one) for one in (view, replace(view, pixels=view.pixels + 0.9))] == [
        False,
        True,
    ]


def test_enough_views_that_leave_edges_open_are_not_complete():
    views = shown(LENS, 60, 1)
    middle = ViewTaker(640, 480)
    for view in views:
        near = (np.abs(view.pixels - (320, 240)) < (190, 140)).all(axis=1)
        part = replace(view, ids=view.ids[near], points=view.points[near], pixels=view.pixels[near])
        middle.offer(part)
        middle.offer(part)
    assert len(middle.views) >= WANTED_VIEWS
    assert set(middle.open_edges) == {
        "top left", "top", "top right", "left", "right", "bottom left", "bottom", "bottom right",
    }  # fmt: skip
    assert not middle.is_complete
    everywhere = ViewTaker(640, 480)
    for view in views:
        everywhere.offer(view)
        everywhere.offer(view)
    assert everywhere.open_edges == []
    assert everywhere.is_complete


def test_the_board_is_printed_on_a4_in_true_scale_and_never_over_a_file(tmp_path):
    path = tmp_path / "board.pdf"
    runner = CliRunner()
    written = runner.invoke(cli.app, ["calibrate", "board", str(path)])
    assert written.exit_code == 0
    assert "--square-mm" in written.output
    page = path.read_bytes()
    streams = re.findall(rb"stream\r?\n(.*?)endstream", page, re.DOTALL)
    unpacked = [zlib.decompressobj().decompress(one) for one in streams if one.startswith(b"x")]
    # cairo 1.18 packs what describes the page as well
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+)", b"\n".join([page, *unpacked]))
    assert box is not None
    assert [float(side) * 25.4 / 72 for side in box.groups()] == pytest.approx([210, 297], abs=0.1)
    again = runner.invoke(cli.app, ["calibrate", "board", str(path)])
    assert again.exit_code != 0
    assert path.read_bytes() == page


def test_what_is_printed_is_the_board_that_is_looked_for():
    """Drawn by the same commands onto pixels, 100 of them an inch."""
    dots = 100 / 72
    surface = cairo.ImageSurface(cairo.FORMAT_RGB24, round(595.3 * dots), round(841.9 * dots))
    context = cairo.Context(surface)
    context.set_source_rgb(1, 1, 1)
    context.paint()
    context.set_source_rgb(0, 0, 0)
    context.scale(dots, dots)
    printed._draw(context)
    pixels = np.ndarray((surface.get_height(), surface.get_stride() // 4, 4), np.uint8,
                        surface.get_data())  # fmt: skip
    view = BOARD.find(np.ascontiguousarray(pixels[:, : surface.get_width(), :3]))
    assert view is not None
    assert len(view.ids) == 24
    apart = view.pixels[view.ids == 23] - view.pixels[view.ids == 0]
    squares = np.array((COLUMNS - 2, ROWS - 2))
    assert apart[0] == pytest.approx(squares * SQUARE_MM / 25.4 * 100, abs=0.3)
