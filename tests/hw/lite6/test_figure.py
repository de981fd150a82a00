"""The figure of the Lite 6 that viewers draw is that of our own scene."""

from __future__ import annotations

from importlib import resources
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from hw.arms import arm_kind
from hw.lite6.kind import Lite6Figure
from tams_app.records import Solid, SolidKind

pytestmark = pytest.mark.untimed

FIGURE = Lite6Figure()
SCENE = resources.files("hw.sim.world") / "rig.xml"


def ends(solid: Solid) -> set[tuple[float, ...]]:
    half = solid.pose.rotation.apply((0.0, 0.0, solid.extent[2] / 2))
    middle = solid.pose.position
    return {tuple(np.round(middle + sign * half, 6) + 0.0) for sign in (-1, 1)}


def rods(body: ElementTree.Element) -> list[tuple[float, set[tuple[float, ...]]]]:
    """Radius and ends of the scene's cylinders and capsules in a body's frame."""
    found = []
    for geom in body.findall("geom"):
        size = [float(one) for one in geom.get("size", "").split()]
        if geom.get("fromto"):
            numbers = [float(one) for one in geom.get("fromto", "").split()]
            start, end = numbers[:3], numbers[3:]
        elif geom.get("type") == "cylinder":
            x, y, z = (float(one) for one in geom.get("pos", "0 0 0").split())
            start, end = [x, y, z - size[1]], [x, y, z + size[1]]
        else:
            continue
        found.append((size[0], {tuple(np.round(one, 6) + 0.0) for one in (start, end)}))
    return found


@pytest.mark.parametrize("frame", FIGURE.solids)
def test_each_rod_of_a_link_is_one_of_the_scene(frame: str) -> None:
    tree = ElementTree.fromstring(SCENE.read_text(encoding="utf-8"))
    (body,) = (one for one in tree.iter("body") if one.get("name") == frame)
    known = rods(body)
    for solid in FIGURE.solids[frame]:
        if solid.kind is SolidKind.CYLINDER:
            assert (solid.extent[0] / 2, ends(solid)) in known


@pytest.mark.parametrize("joints", [np.zeros(6), np.array([0.3, -0.4, 1.1, 0.5, -0.7, 2.0])])
def test_the_links_are_where_the_scene_has_them(joints: Any) -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    for number, angle in enumerate(joints, start=1):
        data.qpos[model.joint(f"joint{number}").qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)
    for frame, pose in FIGURE.place(joints).items():
        assert np.allclose(pose.position, data.body(frame).xpos, atol=1e-6), frame
        matrix = data.body(frame).xmat.reshape(3, 3)
        assert np.allclose(pose.rotation.as_matrix(), matrix, atol=1e-6), frame


def test_the_flange_is_a_link_and_the_kind_of_arm_has_this_figure() -> None:
    assert FIGURE.flange in FIGURE.solids
    figure = arm_kind("lite6").figure()
    assert figure is not None
    assert figure.solids == FIGURE.solids


def boxes_of_fingers(closed_m: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Middle and half size of the scene's boxes of the fingers in the flange's frame."""
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    for finger in ("finger_left", "finger_right"):
        data.qpos[model.joint(finger).qposadr[0]] = closed_m
    mujoco.mj_kinematics(model, data)
    flange = data.body(FIGURE.flange)
    turn = flange.xmat.reshape(3, 3)
    return [
        ((data.geom_xpos[geom] - flange.xpos) @ turn, model.geom_size[geom])
        for geom in range(model.ngeom)
        if model.body(int(model.geom_bodyid[geom])).name.startswith("finger_")
    ]


def test_the_fingers_are_those_of_the_scene_when_open() -> None:
    drawn = [(one.pose.position, np.array(one.extent) / 2) for one in FIGURE.solids[FIGURE.flange]]
    for middle, half in boxes_of_fingers(0.0):
        assert any(np.allclose(middle, at) and np.allclose(half, size) for at, size in drawn)


def test_the_grip_covers_the_fingers_when_closed_and_a_block_between_them() -> None:
    (grip,) = FIGURE.grip
    reach = np.array(grip.extent) / 2
    block = np.array([0.0, 0.0, 0.084]), np.array([0.0085, 0.0060, 0.010])
    for middle, half in (*boxes_of_fingers(0.002), block):
        assert (np.abs(middle - grip.pose.position) + half <= reach + 1e-4).all()
