"""Conversion of records to Foxglove messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    Quaternion,
    SceneEntity,
    Vector3,
)
from foxglove.messages import Pose as FoxglovePose

from tams_app.recording.mcap_log import timestamp
from tams_app.records import Pose, Solid, SolidKind
from tams_app.vectors import Floats3

BASE = "base"


def vector(numbers: Iterable[float]) -> Vector3:
    x, y, z = map(float, numbers)
    return Vector3(x=x, y=y, z=z)


def pose_of(pose: Pose) -> FoxglovePose:
    x, y, z, w = pose.rotation
    return FoxglovePose(position=vector(pose.position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def transform(wall_ns: int, parent: str, child: str, pose: Pose) -> FrameTransform:
    """The pose of the frame `child` in the frame `parent`."""
    x, y, z, w = pose.rotation
    return FrameTransform(
        timestamp=timestamp(wall_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=vector(pose.position),
        rotation=Quaternion(x=x, y=y, z=z, w=w),
    )


def colour_of(colour: Floats3, alpha: float = 1.0) -> Color:
    red, green, blue = colour
    return Color(r=red, g=green, b=blue, a=alpha)


def entities(wall_ns: int, solids: Mapping[str, tuple[Solid, ...]]) -> list[SceneEntity]:
    """One for each frame, which moves with it."""
    return [_entity(wall_ns, frame, parts) for frame, parts in solids.items()]


def _entity(wall_ns: int, frame: str, solids: tuple[Solid, ...]) -> SceneEntity:
    return SceneEntity(
        timestamp=timestamp(wall_ns),
        frame_id=frame,
        id=frame,
        frame_locked=True,
        cubes=[
            CubePrimitive(
                pose=pose_of(one.pose), size=vector(one.extent), color=colour_of(one.colour)
            )
            for one in solids
            if one.kind is SolidKind.BOX
        ],
        cylinders=[
            CylinderPrimitive(
                pose=pose_of(one.pose),
                size=vector(one.extent),
                bottom_scale=1.0,
                top_scale=1.0,
                color=colour_of(one.colour),
            )
            for one in solids
            if one.kind is SolidKind.CYLINDER
        ],
    )
