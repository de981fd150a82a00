"""All channels for Foxglove's viewers of one session, and the messages that its records become."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from foxglove import Context, channels, messages

from tams_app.recording import Header, Viewer
from tams_app.recording.mcap_log import json_channel, timestamp
from tams_app.recording.rates import RATES, Rates
from tams_app.recording.topics import PICTURE_PREFIX, OutcomeGiven
from tams_app.records import (
    ArmState,
    Lens,
    MountPrediction,
    Note,
    Pose,
    SceneTruth,
    ShownFrame,
    Solid,
    SolidKind,
    StopRecord,
    Tick,
)
from tams_app.rotation import Rotation
from tams_app.telemetry.scene import (
    BASE,
    MOTION_HZ,
    TRACKING,
    Pace,
    PlacedFrame,
    Scene,
    Spoken,
    joint_angles,
    line_of,
    thing_frames,
)
from tams_app.vectors import Floats3

if TYPE_CHECKING:  # loaded where viewers may connect
    from tams_app.telemetry.gate import Address, LiveServer

SCENE_HZ = 0.2  # again and again, as a viewer that connects late knows only what it receives
PREDICTED = "flange predicted"  # the frame of where it is believed to be now
LED = "flange commanded"  # of where the hand's samples so far lead it
_LEVELS = {
    "info": messages.LogLevel.Info,
    "warning": messages.LogLevel.Warning,
    "error": messages.LogLevel.Error,
}
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 70)
_BOX_COLOUR = (0.95, 0.75, 0.10)
_BOX_LINE_PX = 2.0


class Telemetry(Viewer):
    """Feeds every channel: sentences, what moves at a viewer's pace, pictures, scene, rates.

    A few frames a second of each view are pictures, each readable by itself: the bitstream can be
    decoded from a keyframe on, and the wire has one in 20 s. JPEG, as measured on the rig's frames
    at 640×480: 0.8 ms and 34 kB for each picture, twice a second of three views 0.5 % of a core and
    200 kB/s. A second H.264 stream with a keyframe a second, x264 `ultrafast` at 10 frames a
    second: 1.5 ms each, 4.5 % of a core and 100 kB/s, and a pipeline for each view.
    """

    def __init__(
        self,
        context: Context,
        header: Header,
        scene: Scene,
        pictures_per_s: float,
        address: Address | None = None,
        origins: Collection[str] = (),
    ) -> None:
        """Channels of `context`, served at `address` to programs and to pages of `origins`.

        SetupError if they cannot be.
        """
        self._offset_ns = header.wall_offset_ns
        self._scene = scene
        self._scene_pace, self._motion_pace = Pace(SCENE_HZ), Pace(MOTION_HZ)
        self._prediction_pace = Pace(MOTION_HZ)
        shown = header.views if pictures_per_s else ()
        self._picture_paces = {view: Pace(pictures_per_s) for view in shown}
        self._reported_ns = 0
        kinds: dict[str, Any] = {
            "/log": channels.LogChannel,
            "/tf": channels.FrameTransformsChannel,
            "/tf/things": channels.FrameTransformsChannel,
            "/tf/predicted": channels.FrameTransformsChannel,
            "/joints": channels.JointStatesChannel,
            "/pose/hand": channels.PoseInFrameChannel,
            "/pose/commanded": channels.PoseInFrameChannel,
            **{PICTURE_PREFIX + view: channels.CompressedImageChannel for view in shown},
            "/tf_static": channels.FrameTransformsChannel,
            "/scene/workspace": channels.SceneUpdateChannel,
            "/scene/robot": channels.SceneUpdateChannel,
            "/scene/things": channels.SceneUpdateChannel,
            **{
                _calibration_topic(view): channels.CameraCalibrationChannel for view in scene.lenses
            },
        }
        self._channels = {topic: kind(topic, context=context) for topic, kind in kinds.items()}
        self._channels[RATES.name] = json_channel(context, RATES)
        self._server: LiveServer | None = None
        if address is not None:
            from tams_app.telemetry.gate import LiveServer

            self._server = LiveServer(context, address, header.name, origins)

    def receive(self, record: Any) -> None:
        match record:
            case Tick():
                self._on_tick(record)
            case SceneTruth():
                self._log_frames("/tf/things", record.t_ns, thing_frames(record))
            case MountPrediction():
                self._on_prediction(record)
            case Note() | StopRecord() | OutcomeGiven():
                self._on_line(record)
            case Rates():
                self._log(RATES.name, record.t_ns, RATES.encode(record))
            case ShownFrame():
                self._on_picture(record)

    def wants(self, view: str, shown_ns: int) -> bool:
        pace = self._picture_paces.get(view)
        return pace is not None and pace.is_due(shown_ns)

    def close(self) -> None:
        """Let the viewers go; may be called twice."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()

    def _on_line(self, record: Spoken) -> None:
        line = line_of(record)
        level, stamp = _LEVELS.get(line.level, messages.LogLevel.Unknown), self._stamp(line.t_ns)
        message = messages.Log(timestamp=stamp, level=level, name=line.kind, message=line.text)
        self._log("/log", line.t_ns, message)

    def _on_tick(self, tick: Tick) -> None:
        """Report, command and hand of a tick, if it is time; the scene more rarely."""
        t_ns, arm = tick.started_ns, tick.arm
        if self._scene_pace.is_due(t_ns):
            self._log_scene(t_ns)
        if not self._motion_pace.is_due(t_ns):
            return
        if tick.controller.pose is not None:
            self._log_pose("/pose/hand", t_ns, TRACKING, tick.controller.pose)
        if arm is None:
            return
        if arm.received_ns != self._reported_ns:
            self._reported_ns = arm.received_ns
            self._log_arm(arm)
        commanded = _led_to(tick, arm.tcp, self._scene.twist_lasts_s)
        self._log_pose("/pose/commanded", t_ns, BASE, commanded)

    def _on_prediction(self, prediction: MountPrediction) -> None:
        """Where the flange is believed to be, if it is time."""
        if not self._prediction_pace.is_due(prediction.now_ns):
            return
        moved: list[PlacedFrame] = [(BASE, PREDICTED, prediction.now)]
        if prediction.commanded is not None:
            moved.append((BASE, LED, prediction.commanded))
        self._log_frames("/tf/predicted", prediction.now_ns, moved)

    def _on_picture(self, shown: ShownFrame) -> None:
        """OpenCV encodes it without the GIL."""
        _, data = cv2.imencode(".jpg", shown.image, _QUALITY)
        stamp = self._stamp(shown.shown_ns)
        message = messages.CompressedImage(
            timestamp=stamp, frame_id=shown.view, data=data.tobytes(), format="jpeg"
        )
        self._log(PICTURE_PREFIX + shown.view, shown.shown_ns, message)

    def _log_arm(self, arm: ArmState) -> None:
        self._log_frames("/tf", arm.received_ns, self._scene.arm_frames(arm))
        joints = [
            messages.JointState(name=name, position=angle)
            for name, angle in joint_angles(arm).items()
        ]
        message = messages.JointStates(timestamp=self._stamp(arm.received_ns), joints=joints)
        self._log("/joints", arm.received_ns, message)

    def _log_scene(self, t_ns: int) -> None:
        scene, wall_ns = self._scene, t_ns + self._offset_ns
        self._log_frames("/tf_static", t_ns, scene.still_frames())
        self._log("/scene/workspace", t_ns, wire_box(wall_ns, *scene.workspace))
        if scene.figure is not None:
            self._log("/scene/robot", t_ns, solid_things(wall_ns, scene.figure.solids))
        if scene.things:
            self._log("/scene/things", t_ns, solid_things(wall_ns, scene.things))
        for view, lens in scene.lenses.items():
            self._log(_calibration_topic(view), t_ns, calibration(wall_ns, view, lens))

    def _log_frames(self, topic: str, t_ns: int, frames: Iterable[PlacedFrame]) -> None:
        self._log(topic, t_ns, transforms(t_ns + self._offset_ns, frames))

    def _log_pose(self, topic: str, t_ns: int, frame: str, pose: Pose) -> None:
        message = messages.PoseInFrame(
            timestamp=self._stamp(t_ns), frame_id=frame, pose=pose_of(pose)
        )
        self._log(topic, t_ns, message)

    def _stamp(self, t_ns: int) -> messages.Timestamp:
        return timestamp(t_ns + self._offset_ns)

    def _log(self, topic: str, t_ns: int, message: Any) -> None:
        self._channels[topic].log(message, log_time=t_ns + self._offset_ns)


def _calibration_topic(view: str) -> str:
    return f"/camera/{view}/calibration"


def _led_to(tick: Tick, tcp: Pose, seconds: float) -> Pose:
    """The pose that the tick's twist takes the TCP to if no other command follows."""
    position = tcp.position + np.multiply(tick.twist.linear, seconds)
    turn = Rotation.from_rotvec(np.multiply(tick.twist.angular, seconds))
    return Pose(position, turn * tcp.rotation)


def pose_of(pose: Pose) -> messages.Pose:
    return messages.Pose(position=_vector(pose.position), orientation=_quaternion(pose))


def transforms(wall_ns: int, frames: Iterable[PlacedFrame]) -> messages.FrameTransforms:
    """Where the frames are."""
    return messages.FrameTransforms(
        transforms=[
            messages.FrameTransform(
                timestamp=timestamp(wall_ns),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=_vector(pose.position),
                rotation=_quaternion(pose),
            )
            for parent, child, pose in frames
        ]
    )


def solid_things(wall_ns: int, solids: Mapping[str, tuple[Solid, ...]]) -> messages.SceneUpdate:
    """An entity for each frame, which moves with it."""
    return messages.SceneUpdate(
        entities=[_entity(wall_ns, frame, one) for frame, one in solids.items()]
    )


def wire_box(wall_ns: int, lower: Floats3, upper: Floats3) -> messages.SceneUpdate:
    """The edges of the workspace, between its corners in the base frame [m]."""
    corners = list(product(*zip(lower, upper, strict=True)))
    edges = [
        (first, second)
        for number, first in enumerate(corners)
        for second in corners[number + 1 :]
        if sum(a != b for a, b in zip(first, second, strict=True)) == 1
    ]
    lines = messages.LinePrimitive(
        type=messages.LinePrimitiveLineType.LineList,
        thickness=_BOX_LINE_PX,
        scale_invariant=True,
        points=[messages.Point3(x=x, y=y, z=z) for edge in edges for x, y, z in edge],
        color=_colour(_BOX_COLOUR, alpha=0.8),
    )
    stamp = timestamp(wall_ns)
    box = messages.SceneEntity(timestamp=stamp, frame_id=BASE, id="workspace", lines=[lines])
    return messages.SceneUpdate(entities=[box])


def calibration(wall_ns: int, view: str, lens: Lens) -> messages.CameraCalibration:
    """How the view's picture is made, in OpenCV's pixels; rectified it has the same matrix."""
    matrix = lens.matrix()
    return messages.CameraCalibration(
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


def _vector(numbers: Iterable[float]) -> messages.Vector3:
    x, y, z = map(float, numbers)
    return messages.Vector3(x=x, y=y, z=z)


def _quaternion(pose: Pose) -> messages.Quaternion:
    x, y, z, w = pose.rotation
    return messages.Quaternion(x=x, y=y, z=z, w=w)


def _colour(colour: Floats3, alpha: float = 1.0) -> messages.Color:
    red, green, blue = colour
    return messages.Color(r=red, g=green, b=blue, a=alpha)


def _entity(wall_ns: int, frame: str, solids: tuple[Solid, ...]) -> messages.SceneEntity:
    return messages.SceneEntity(
        timestamp=timestamp(wall_ns),
        frame_id=frame,
        id=frame,
        frame_locked=True,
        cubes=[
            messages.CubePrimitive(
                pose=pose_of(one.pose), size=_vector(one.extent), color=_colour(one.colour)
            )
            for one in solids
            if one.kind is SolidKind.BOX
        ],
        cylinders=[
            messages.CylinderPrimitive(
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
