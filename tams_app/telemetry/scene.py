"""The constants of a session: the arm's figure, its workspace, the cameras' lenses.

Sent again every few seconds, as a viewer that connects late knows only what it receives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from foxglove import Context
from foxglove.channels import CameraCalibrationChannel, FrameTransformsChannel, SceneUpdateChannel
from foxglove.messages import (
    CameraCalibration,
    FrameTransforms,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    SceneEntity,
    SceneUpdate,
)

from tams_app.recording.mcap_log import timestamp
from tams_app.records import ArmFigure, ArmState, Lens, Pose, SceneTruth, Solid
from tams_app.telemetry.messages import BASE, colour_of, entities, transform
from tams_app.vectors import Floats3

TRACKING = "tracking"
_BOX_COLOUR = (0.95, 0.75, 0.10)
_BOX_LINE_PX = 2.0


@dataclass(frozen=True, slots=True)
class Scene:
    """The surroundings as they are known when a session starts."""

    figure: ArmFigure | None  # None: not known
    workspace: tuple[Floats3, Floats3]  # lower and upper corner for the TCP, base frame [m]
    tracking: Pose  # of the controller's tracking frame in the base frame
    twist_lasts_s: float  # a velocity command without another moves the arm so long
    things: Mapping[str, tuple[Solid, ...]]  # by frame; none where only a camera sees them
    lenses: Mapping[str, Lens]  # by view; none where they were not measured

    def arm_frames(self, arm: ArmState) -> Mapping[str, Pose]:
        """The TCP as reported, and the links as the reported joints put them, in the base frame."""
        links = {} if self.figure is None else self.figure.place(arm.joints)
        return {"tcp": arm.tcp, **links}

    def still_frames(self) -> Iterator[tuple[str, str, Pose]]:
        """Parent, frame and pose of what does not move in its parent: tracking, and the views."""
        yield BASE, TRACKING, self.tracking
        for view, lens in self.lenses.items():
            yield lens.parent, view, lens.pose


def thing_frames(truth: SceneTruth) -> Mapping[str, Pose]:
    """The poses of the rig's things in the base frame."""
    return {"block": truth.block, "container": truth.container}


class SceneChannels:
    """Sends the scene."""

    def __init__(self, context: Context, scene: Scene) -> None:
        self._scene = scene
        self._still = FrameTransformsChannel("/tf_static", context=context)
        self._workspace = SceneUpdateChannel("/scene/workspace", context=context)
        self._robot = SceneUpdateChannel("/scene/robot", context=context)
        self._things = SceneUpdateChannel("/scene/things", context=context)
        self._lenses = {
            view: CameraCalibrationChannel(f"/camera/{view}/calibration", context=context)
            for view in scene.lenses
        }

    def send(self, wall_ns: int) -> None:
        """Everything, at this instant."""
        scene = self._scene
        still = [transform(wall_ns, *one) for one in scene.still_frames()]
        self._still.log(FrameTransforms(transforms=still), log_time=wall_ns)
        box = SceneUpdate(entities=[_wire_box(wall_ns, *scene.workspace)])
        self._workspace.log(box, log_time=wall_ns)
        if scene.figure is not None:
            robot = SceneUpdate(entities=entities(wall_ns, scene.figure.solids))
            self._robot.log(robot, log_time=wall_ns)
        if scene.things:
            things = SceneUpdate(entities=entities(wall_ns, scene.things))
            self._things.log(things, log_time=wall_ns)
        for view, channel in self._lenses.items():
            channel.log(_calibration(wall_ns, view, scene.lenses[view]), log_time=wall_ns)


def _wire_box(wall_ns: int, lower: Floats3, upper: Floats3) -> SceneEntity:
    corners = list(product(*zip(lower, upper, strict=True)))
    edges = [
        (first, second)
        for number, first in enumerate(corners)
        for second in corners[number + 1 :]
        if sum(a != b for a, b in zip(first, second, strict=True)) == 1
    ]
    return SceneEntity(
        timestamp=timestamp(wall_ns),
        frame_id=BASE,
        id="workspace",
        lines=[
            LinePrimitive(
                type=LinePrimitiveLineType.LineList,
                thickness=_BOX_LINE_PX,
                scale_invariant=True,
                points=[Point3(x=x, y=y, z=z) for edge in edges for x, y, z in edge],
                color=colour_of(_BOX_COLOUR, alpha=0.8),
            )
        ],
    )


def _calibration(wall_ns: int, view: str, lens: Lens) -> CameraCalibration:
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
