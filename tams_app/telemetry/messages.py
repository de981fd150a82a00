"""Conversion of records to Foxglove messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

import numpy as np
from foxglove.messages import (
    CameraCalibration,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    Vector3,
)
from foxglove.messages import Pose as FoxglovePose

from tams_app.recording.mcap_log import timestamp
from tams_app.records import Lens, Pose, Solid, SolidKind
from tams_app.telemetry.scene import BASE, PlacedFrame
from tams_app.vectors import Floats3

_BOX_COLOUR = (0.95, 0.75, 0.10)
_BOX_LINE_PX = 2.0


def pose_of(pose: Pose) -> FoxglovePose:
    return FoxglovePose(position=_vector(pose.position), orientation=_quaternion(pose))


def transforms(wall_ns: int, frames: Iterable[PlacedFrame]) -> FrameTransforms:
    """Where the frames are."""
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=timestamp(wall_ns),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=_vector(pose.position),
                rotation=_quaternion(pose),
            )
            for parent, child, pose in frames
        ]
    )


def solid_things(wall_ns: int, solids: Mapping[str, tuple[Solid, ...]]) -> SceneUpdate:
    """An entity for each frame, which moves with it."""
    return SceneUpdate(entities=[_entity(wall_ns, frame, one) for frame, one in solids.items()])


def wire_box(wall_ns: int, lower: Floats3, upper: Floats3) -> SceneUpdate:
    """The edges of the workspace, between its corners in the base frame [m]."""
    corners = list(product(*zip(lower, upper, strict=True)))
    edges = [
        (first, second)
        for number, first in enumerate(corners)
        for second in corners[number + 1 :]
        if sum(a != b for a, b in zip(first, second, strict=True)) == 1
    ]
    lines = LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        thickness=_BOX_LINE_PX,
        scale_invariant=True,
        points=[Point3(x=x, y=y, z=z) for edge in edges for x, y, z in edge],
        color=_colour(_BOX_COLOUR, alpha=0.8),
    )
    stamp = timestamp(wall_ns)
    box = SceneEntity(timestamp=stamp, frame_id=BASE, id="workspace", lines=[lines])
    return SceneUpdate(entities=[box])


def calibration(wall_ns: int, view: str, lens: Lens) -> CameraCalibration:
    """How the view's picture is made, in OpenCV's pixels; rectified it has the same matrix."""
    matrix = lens.matrix()
    return CameraCalibration(
        timestamp=timestamp(wall_ns),
        frame_id=view,
        width=lens.width,
        height=lens.height,
        distortion_model="plumb_bob",
        D=list(lens.distortion),
        K=matrix.ravel().tolist(),
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=np.insert(matrix, 3, 0.0, axis=1).ravel().tolist(),
    )


def _vector(numbers: Iterable[float]) -> Vector3:
    x, y, z = map(float, numbers)
    return Vector3(x=x, y=y, z=z)


def _quaternion(pose: Pose) -> Quaternion:
    x, y, z, w = pose.rotation
    return Quaternion(x=x, y=y, z=z, w=w)


def _colour(colour: Floats3, alpha: float = 1.0) -> Color:
    red, green, blue = colour
    return Color(r=red, g=green, b=blue, a=alpha)


def _entity(wall_ns: int, frame: str, solids: tuple[Solid, ...]) -> SceneEntity:
    return SceneEntity(
        timestamp=timestamp(wall_ns),
        frame_id=frame,
        id=frame,
        frame_locked=True,
        cubes=[
            CubePrimitive(
                pose=pose_of(one.pose), size=_vector(one.extent), color=_colour(one.colour)
            )
            for one in solids
            if one.kind is SolidKind.BOX
        ],
        cylinders=[
            CylinderPrimitive(
                pose=pose_of(one.pose),
                size=_vector(one.extent),
                bottom_scale=1.0,
                top_scale=1.0,
                color=_colour(one.colour),
            )
            for one in solids
            if one.kind is SolidKind.CYLINDER
        ],
    )
