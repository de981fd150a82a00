"""config/lite6.yaml: the task it is for can be done with it, and a copy of it works anywhere."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from hw.sim.layout import BLOCK_HEIGHT_M, draw_layout
from hw.sim.operator.task import GRASP_ABOVE_CENTRE_M, RELEASE_HEIGHT_M, TRAVEL_HEIGHT_M
from tams_app.config import CONFIG_DIRECTORY, dump_config, load_config
from tams_app.errors import ConfigError
from tams_app.robot.build import check_ready_pose, check_views
from tams_app.teleop.limits import linear_profile
from tams_app.teleop.workspace import Workspace

pytestmark = pytest.mark.untimed

PROFILE = CONFIG_DIRECTORY / "lite6.yaml"
GUIDE = CONFIG_DIRECTORY.parent / "docs" / "OPERATOR.md"
ROOM_M = 0.004  # the arm crawls over the last millimetres before a bound


def test_the_fingertips_reach_every_block_and_container_of_the_rig():
    config = load_config(PROFILE)
    motion, deadman_s = linear_profile(config.limits.motion), config.arm.velocity_deadman_s
    workspace = Workspace(config.limits, motion, deadman_s)
    points = []
    for seed in range(500):
        layout = draw_layout(seed)
        for placement, low in (
            (layout.block, BLOCK_HEIGHT_M / 2 + GRASP_ABOVE_CENTRE_M),
            (layout.container, RELEASE_HEIGHT_M),
        ):
            points += [(placement.x, placement.y, z) for z in (low, *TRAVEL_HEIGHT_M)]
    assert max(max(workspace.excess(point)) for point in points) < -ROOM_M


def test_the_arm_can_work_from_the_ready_pose():
    check_ready_pose(load_config(PROFILE))
    check_ready_pose(load_config())


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ({"limits.floor_mm": 200}, r"\(350, 0, 180\) mm, 20 mm outside limits.floor_mm"),
        ({"limits.box_min_mm": [360, -250, 0]}, "10 mm outside limits.box_min_mm"),
        ({"limits.box_max_mm": [410, -10, 350]}, "10 mm outside limits.box_max_mm"),
        ({"limits.radius_max_mm": 340}, "10 mm outside limits.radius_max_mm"),
        ({"limits.radius_min_mm": 360}, "10 mm outside limits.radius_min_mm"),
        ({"arm.tcp_offset_mm_deg": [0, 0, 282, 0, 0, 0]}, "outside limits.floor_mm"),
        ({"limits.max_speed_mm_s": 60}, "limits.leash_mm must be below .*, 15, or an arm"),
        ({"limits.max_rotation_rad_s": 0.2}, "limits.leash_rad must be below .*, 0.05, or an arm"),
    ],
)
def test_a_ready_pose_outside_a_bound_and_a_leash_that_would_hide_an_arm_at_rest_are_refused(
    overrides, sentence
):
    with pytest.raises(ConfigError, match=sentence):
        check_ready_pose(load_config(PROFILE, overrides))


def test_a_copy_of_the_profile_works_in_any_folder(tmp_path):
    copy = Path(shutil.copy(PROFILE, tmp_path / "ours.yaml"))
    assert load_config(copy) == load_config(PROFILE)


@pytest.mark.parametrize("cameras", [None, {"source": "pattern"}, {"source": "file", "file": "a"}])
def test_what_a_session_leaves_of_it_reads_back_the_same(tmp_path, cameras):
    keys = {"cameras": dict.fromkeys(("eih", "gt", "gs"), cameras)} if cameras else {}
    config = load_config(PROFILE, keys)
    path = tmp_path / "config.yaml"
    path.write_text(dump_config(config))
    assert load_config(path) == config


def test_a_file_beside_the_copy_goes_before_ours(tmp_path):
    copy = Path(shutil.copy(PROFILE, tmp_path / "ours.yaml"))
    (tmp_path / "networks.yaml").write_text("networks:\n  none: {}\n  lab: {latency_ms: 7}\n")
    assert set(load_config(copy).networks) == {"none", "lab"}


def documented_rotations():
    """The guide's table of `hand.rotation`: the arm's axis that is looked along, and the matrix."""
    rows = re.findall(r"^\| .*\| ([+−][xy]) \| `(\[\[.*\]\])` \|$", GUIDE.read_text("utf-8"), re.M)
    return [
        (axis, [[int(n) for n in re.findall(r"-?\d", r)] for r in m.split("],")])
        for axis, m in rows
    ]


def test_the_guide_has_the_four_standpoints_and_the_profile_the_first_of_them():
    (axis, matrix), *others = documented_rotations()
    assert axis == "+x"
    assert {other for other, _ in others} == {"−x", "+y", "−y"}
    np.testing.assert_array_equal(load_config(PROFILE).hand.rotation, matrix)


@pytest.mark.parametrize(("axis", "matrix"), documented_rotations())
def test_a_documented_rotation_moves_the_arm_as_the_hand_moves(axis, matrix):
    config = load_config(PROFILE, {"hand.rotation": matrix})  # refuses what is no proper rotation
    forward = {"x": np.array([1, 0, 0]), "y": np.array([0, 1, 0])}[axis[1]]
    forward = forward if axis[0] == "+" else -forward
    rotation, up = np.array(config.hand.rotation), np.array([0, 0, 1])
    np.testing.assert_array_equal(rotation @ [0, 0, -1], forward)  # z is backwards in tracking
    np.testing.assert_array_equal(rotation @ [0, 1, 0], up)
    np.testing.assert_array_equal(rotation @ [1, 0, 0], np.cross(forward, up))


def test_a_real_arm_moves_by_a_camera_of_another_distribution():
    config = load_config(PROFILE)
    camera = next(iter(config.cameras.values())).model_copy(update={"source": "outside"})
    cameras = dict.fromkeys(config.video.views, camera)
    check_views(config.model_copy(update={"cameras": cameras}), dry_run=False)
