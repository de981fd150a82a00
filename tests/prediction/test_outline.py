from dataclasses import replace

import cv2
import numpy as np
import pytest

from hw.lite6.kind import Lite6Figure
from tams_app.config import load_config
from tams_app.prediction.outline import ArmOutline, PlacedArm, links_of
from tams_app.prediction.plane_warp import corners_of, mounted, silhouette
from tams_app.records import Lens, Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tams_app.session.predicting import predicted_cameras
from tests.prediction.wrist import LOOKS_DOWN, STRAIGHT, above

pytestmark = pytest.mark.untimed

LENS = Lens.ideal("base", Pose(np.array([0.0, 0.0, 0.8]), LOOKS_DOWN), 40.0, 320, 240)
BOX = Solid(SolidKind.BOX, Pose(np.zeros(3), STRAIGHT), (0.06, 0.04, 0.02), (0.0,) * 3)
GREY = np.full((240, 320), 120, np.uint8)
THEN, NOW = above(0.0, 0.0, 0.2), above(0.06, -0.03, 0.25, Rotation.from_rotvec((0.0, 0.0, 0.4)))
MOVED, STANDS = (PlacedArm(THEN), PlacedArm(NOW)), (PlacedArm(THEN), PlacedArm(THEN))


def pixel(point: np.ndarray) -> np.ndarray:
    x, y, depth = LENS.matrix() @ LENS.pose.rotation.inv().apply(point - LENS.pose.position)
    return np.array([x, y]) / depth


def test_the_outline_encloses_the_tool_where_it_is_now() -> None:
    drawn = ArmOutline(LENS, [BOX]).over(GREY, *MOVED, NOW)
    rows, columns = np.nonzero(drawn > 200)
    corners = [
        pixel(NOW.position + NOW.rotation.apply(np.array([x, y, z])))
        for x in (-0.03, 0.03)
        for y in (-0.02, 0.02)
        for z in (-0.01, 0.01)
    ]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    assert (columns.min(), rows.min()) == pytest.approx(low, abs=1.5)
    assert (columns.max(), rows.max()) == pytest.approx(high, abs=1.5)
    middle = np.rint(np.mean(corners, axis=0)).astype(int)
    assert drawn[middle[1], middle[0]] == 120, "a line, and nothing of what it encloses"


def test_a_line_has_a_dark_edge_is_the_same_in_colour_and_changes_nothing_elsewhere() -> None:
    outline = ArmOutline(LENS, [BOX])
    colour = outline.over(np.repeat(GREY[..., None], 3, axis=2), *MOVED, NOW)
    grey = outline.over(GREY, *MOVED, NOW)
    assert (colour == grey[..., None]).all()
    assert (GREY == 120).all()
    assert grey.min() < 60
    assert (grey != 120).mean() < 0.02


def test_where_the_picture_has_caught_up_nothing_is_drawn() -> None:
    outline = ArmOutline(LENS, [BOX])
    px_per_m = LENS.fx / (0.8 - 0.21)  # of the box's upper side
    for moved_px, is_drawn in ((2.9, False), (3.1, True)):
        now = above(moved_px / px_per_m, 0.0, 0.2)
        assert (outline.over(GREY, PlacedArm(THEN), PlacedArm(now), now) is not None) == is_drawn


def test_a_cross_is_where_the_hand_leads_the_tip_unless_the_arm_is_there() -> None:
    outline = ArmOutline(LENS, [BOX], (0.0, 0.0, 0.05))
    px_per_m = LENS.fx / (0.8 - 0.15)  # of the tip, which is below the flange
    assert outline.over(GREY, *STANDS, above(5.9 / px_per_m, 0.0, 0.2)) is None
    led = above(0.06, 0.04, 0.2)
    drawn = outline.over(GREY, *STANDS, led)
    rows, columns = np.nonzero(drawn > 200)
    tip = pixel(led.position + led.rotation.apply(np.array([0.0, 0.0, 0.05])))
    assert (np.median(columns), np.median(rows)) == pytest.approx(tip, abs=1.0)
    assert (drawn != GREY).sum() < 150, "the picture has caught up: there is no outline"
    both = outline.over(GREY, *MOVED, led)
    assert (both > 200).sum() > (drawn > 200).sum()


def test_an_arm_that_leaves_the_picture_does_not_end_at_its_border() -> None:
    now = above(0.28, 0.0, 0.2)
    drawn = ArmOutline(LENS, [BOX]).over(GREY, PlacedArm(THEN), PlacedArm(now), now)
    lit = np.nonzero(drawn > 200)
    assert lit[1].max() == 315, "it goes on up to the border"
    rows = np.flatnonzero(drawn[:, 315] > 200)
    assert len(rows) == 2, "with a line above and below"
    assert (drawn[rows[0] + 4 : rows[1] - 3, 310:] == 120).all()


@pytest.mark.parametrize("now", [above(2.0, 0.0, 0.2), above(0.0, 0.0, 0.9)])
def test_a_tool_that_is_out_of_the_picture_or_behind_the_camera_leaves_it_as_it_is(
    now: Pose,
) -> None:
    drawn = ArmOutline(LENS, [BOX]).over(GREY, PlacedArm(THEN), PlacedArm(now), now)
    assert (drawn == GREY).all()


JOINTS = np.array([0.0, 0.64, 1.51, 0.0, 0.87, 0.0])


def arm_at(joints: np.ndarray) -> PlacedArm:
    return PlacedArm(Lite6Figure().place(joints)["link6"], joints)


def outline_of(view: str) -> tuple[ArmOutline, Lens]:
    """That of a view of the rig, from its description."""
    camera = predicted_cameras(load_config(None, {"view.predict": "all"}))[view]
    return ArmOutline(camera.lens, camera.tool, camera.tip, camera.links), camera.lens


def black(lens: Lens) -> np.ndarray:
    return np.zeros((lens.height, lens.width), np.uint8)


@pytest.mark.parametrize("view", ["gt", "gs"])
@pytest.mark.parametrize("turn", [0.05, 0.3, -0.6])
def test_the_rig_s_cameras_see_the_arm_within_its_outline(view: str, turn: float) -> None:
    """Places on its upper arm, forearm and wrist, and a fingertip, by the arm's kinematics."""
    outline, lens = outline_of(view)
    now = JOINTS + np.array([turn, 0.0, 0.0, 0.0, 0.0, 0.0])
    drawn = outline.over(black(lens), arm_at(JOINTS), arm_at(now), arm_at(now).mount)
    _, part = cv2.connectedComponents((drawn[4:-4, 4:-4] == 0).astype(np.uint8), connectivity=4)
    background = np.bincount(part[part > 0]).argmax()
    links, seen = Lite6Figure().place(now), 0
    for name, place in (
        ("link2", (0.1, 0.0, 0.088)),
        ("link4", (0.0, 0.0, -0.1)),
        ("link5", (0.0, 0.02, 0.0)),
        ("link6", (0.0, 0.012, 0.075)),
    ):
        at = mounted(links[name], Pose(np.array(place), STRAIGHT)).position
        ((x, y),) = lens.projected(at[None])
        if 4 <= round(x) < lens.width - 4 and 4 <= round(y) < lens.height - 4:
            assert part[round(y) - 4, round(x) - 4] != background, name
            seen += 1
    assert seen
    solids = [
        corners_of(replace(solid, pose=mounted(links[name], solid.pose)))
        for name in links
        for solid in Lite6Figure.solids[name]
    ]
    edge = cv2.morphologyEx(silhouette(solids, lens), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8))
    assert edge[drawn > 200].all(), "the line is at the edge of the links, within two pixels"


def test_solids_that_are_apart_are_not_one() -> None:
    apart = [
        corners_of(Solid(SolidKind.BOX, above(x, 0.0, 0.2), (0.02,) * 3, (0.0,) * 3))
        for x in (-0.1, 0.1)
    ]
    shape = silhouette(apart, LENS)
    assert cv2.connectedComponents(shape)[0] == 3, "the background and two boxes"
    assert (shape == silhouette(apart[:1], LENS) | silhouette(apart[1:], LENS)).all()


def test_of_an_arm_only_what_has_moved_gets_an_outline() -> None:
    outline, lens = outline_of("gs")
    rows = {}
    for name, joint in (("wrist", 4), ("shoulder", 1)):
        now = JOINTS.copy()
        now[joint] += 0.2
        drawn = outline.over(black(lens), arm_at(JOINTS), arm_at(now), arm_at(now).mount)
        rows[name] = int(np.ptp(np.nonzero(drawn > 200)[0]))
    assert rows["wrist"] < 0.7 * rows["shoulder"]
    assert outline.over(black(lens), arm_at(JOINTS), arm_at(JOINTS), arm_at(JOINTS).mount) is None


def test_without_the_joints_the_outline_is_the_tool_s() -> None:
    outline, lens = outline_of("gs")
    then, now = arm_at(JOINTS), arm_at(JOINTS + 0.2)
    tool_only = ArmOutline(lens, Lite6Figure.solids["link6"])
    expected = tool_only.over(black(lens), then, now, now.mount)
    for known in ((then, PlacedArm(now.mount)), (PlacedArm(then.mount), now)):
        drawn = outline.over(black(lens), *known, now.mount)
        assert (drawn == expected).all()
    whole = outline.over(black(lens), then, now, now.mount)
    assert (whole != expected).any()


def test_an_arm_that_is_no_chain_of_turning_joints_has_no_links() -> None:
    class Slides(Lite6Figure):
        def place(self, joints):
            placed = dict(super().place(joints))
            third = placed["link3"]
            placed["link3"] = Pose(third.position + np.array([joints[2], 0.0, 0.0]), third.rotation)
            return placed

    assert len(links_of(Lite6Figure())) == 5
    assert links_of(Slides()) == ()
