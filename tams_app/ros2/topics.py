"""The topics: their names, types and quality of service.

All are reliable: a reader that asks for less matches as well, one that asks for reliability would
not match a writer that offers less. Of the video no message may be lost anyway, as each frame
refers to the one before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct

from tams_app.ros2 import messages
from tams_app.ros2.wire import EMERGENCY_STOP


@dataclass(frozen=True, slots=True)
class RosTopic:
    """Reliable; the last `depth` messages are kept for a slow reader.

    `latched`: readers that come later get the last message too (transient local).
    """

    name: str
    type: type[IdlStruct]
    depth: int = 10
    latched: bool = False

    @property
    def dds_name(self) -> str:
        """The name of the topic on DDS."""
        return f"rt{self.name}"


TCP_POSE = RosTopic("/tams/tcp_pose", messages.PoseStamped)
TWIST = RosTopic("/tams/twist_cmd", messages.TwistStamped)
JOINTS = RosTopic("/joint_states", messages.JointState)
PHASE = RosTopic("/tams/task_phase", messages.String, depth=1, latched=True)
RATES = RosTopic("/tams/rates", messages.Float64MultiArray)
DIAGNOSTICS = RosTopic("/diagnostics", messages.DiagnosticArray)
TF = RosTopic("/tf", messages.TFMessage, depth=100)  # as tf2's own broadcasters
TF_STATIC = RosTopic("/tf_static", messages.TFMessage, depth=1, latched=True)
VIDEO_DEPTH = 30  # a second
# with `ros2.dialect: reference`: what the authors' nodes give, by their names
AUTHORS = (
    RosTopic("/tams/phase", messages.String),
    RosTopic("/tams/bitrate_targets", messages.String),
)

STOP = RosTopic(EMERGENCY_STOP, messages.Empty)

_FIXED = (TCP_POSE, TWIST, JOINTS, PHASE, RATES, DIAGNOSTICS, TF, TF_STATIC)


def video_topic(view: str) -> RosTopic:
    """Of the bitstream of a view."""
    return RosTopic(f"/tams/{_token(view)}/compressed", messages.CompressedVideo, VIDEO_DEPTH)


def published(views: Iterable[str]) -> tuple[RosTopic, ...]:
    """All that we send."""
    return (*_FIXED, *map(video_topic, views))


def _token(name: str) -> str:
    """`name` as a part of a ROS name: letters, digits and _, no digit first."""
    token = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"view_{token}" if not token or token[0].isdigit() else token
