"""The topics of ROS 2 that we send and receive, their quality of service, and their messages.

A message is a type of DDS, made of ROS's own definition, which rosbags brings: a field's unit and
frame are what that says, metres, radians and seconds. The names are those that ROS 2 gives its
types on DDS.

All topics are reliable: a reader that asks for less matches as well, one that asks for reliability
would not match a writer that offers less. Of the video no message may be lost anyway, as each frame
refers to the one before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct, types
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tams_app.ros2.wire import EMERGENCY_STOP
from tams_app.units import NS_PER_S

_TYPES: Any = types
# of foxglove_msgs, which is no part of ROS itself
_COMPRESSED_VIDEO = """
builtin_interfaces/Time timestamp
string frame_id
uint8[] data
string format
"""


@cache
def typestore() -> Typestore:
    """The definitions of the types, from rosbags, which brings those of ROS 2.

    Of ROS 2 Humble (the fields of ours are the same in every later release), and ours.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_COMPRESSED_VIDEO, "foxglove_msgs/msg/CompressedVideo"))
    return store


@cache
def _message(name: str) -> Any:
    """The dataclass of the type that is called so in ROS 2, for DDS."""
    package, _, kind = name.split("/")
    fields = {field: _field(how) for field, how in typestore().get_msgdef(name).fields}
    if not fields:  # DDS knows no empty type: so ROS calls the one field that it gives it
        fields = {"structure_needs_at_least_one_member": _TYPES.uint8}
    return make_idl_struct(kind, f"{package}::msg::dds_::{kind}_", fields)


def _field(how: Any) -> Any:
    """The type of a field on DDS; `how`: as rosbags has it in a definition."""
    match how:
        case Nodetype.NAME, name:
            return _message(name)
        case Nodetype.SEQUENCE, (element, _):
            return _TYPES.sequence[_field(element)]
        case Nodetype.BASE, ("string", _):
            return str
        case Nodetype.BASE, (name, _):
            return getattr(_TYPES, name)
    raise TypeError(f"a field of {how} is in none of our messages")


Time = _message("builtin_interfaces/msg/Time")
HeaderMsg = _message("std_msgs/msg/Header")
String = _message("std_msgs/msg/String")
Empty = _message("std_msgs/msg/Empty")
MultiArrayDimension = _message("std_msgs/msg/MultiArrayDimension")
MultiArrayLayout = _message("std_msgs/msg/MultiArrayLayout")
Float64MultiArray = _message("std_msgs/msg/Float64MultiArray")
Point = _message("geometry_msgs/msg/Point")
Vector3 = _message("geometry_msgs/msg/Vector3")
Quaternion = _message("geometry_msgs/msg/Quaternion")
PoseMsg = _message("geometry_msgs/msg/Pose")
PoseStamped = _message("geometry_msgs/msg/PoseStamped")
TwistMsg = _message("geometry_msgs/msg/Twist")
TwistStamped = _message("geometry_msgs/msg/TwistStamped")
Transform = _message("geometry_msgs/msg/Transform")
TransformStamped = _message("geometry_msgs/msg/TransformStamped")
TFMessage = _message("tf2_msgs/msg/TFMessage")
JointState = _message("sensor_msgs/msg/JointState")
KeyValue = _message("diagnostic_msgs/msg/KeyValue")
DiagnosticStatus = _message("diagnostic_msgs/msg/DiagnosticStatus")
DiagnosticArray = _message("diagnostic_msgs/msg/DiagnosticArray")
CompressedVideo = _message("foxglove_msgs/msg/CompressedVideo")


def time_of(wall_ns: int) -> Any:
    """A time that is given in nanoseconds since 1970."""
    return Time(*divmod(wall_ns, NS_PER_S))


def ros_name(message: type[IdlStruct]) -> str:
    """The name of a type in ROS 2, such as `geometry_msgs/msg/PoseStamped`."""
    return message.__idl_typename__.replace("::msg::dds_::", "/msg/").removesuffix("_")


def type_hash(ros_name: str) -> str:
    """RIHS01 (REP 2011), by which nodes since ROS 2 Iron distinguish versions of a type."""
    return typestore().hash_rihs01(ros_name)


def cdr(message: IdlStruct) -> bytes:
    """As ROS 2 has it on the wire and in bags: little-endian CDR (XCDR1) with its header."""
    return message.serialize(use_version_2=False)


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


TCP_POSE = RosTopic("/tams/tcp_pose", PoseStamped)
TWIST = RosTopic("/tams/twist_cmd", TwistStamped)
JOINTS = RosTopic("/joint_states", JointState)
PHASE = RosTopic("/tams/task_phase", String, depth=1, latched=True)
RATES = RosTopic("/tams/rates", Float64MultiArray)
DIAGNOSTICS = RosTopic("/diagnostics", DiagnosticArray)
TF = RosTopic("/tf", TFMessage, depth=100)  # as tf2's own broadcasters
TF_STATIC = RosTopic("/tf_static", TFMessage, depth=1, latched=True)
VIDEO_DEPTH = 30  # a second
# with `ros2.dialect: reference`: what the authors' nodes give, by their names
AUTHORS = (
    RosTopic("/tams/phase", String),
    RosTopic("/tams/bitrate_targets", String),
)

STOP = RosTopic(EMERGENCY_STOP, Empty)

_FIXED = (TCP_POSE, TWIST, JOINTS, PHASE, RATES, DIAGNOSTICS, TF, TF_STATIC)


def video_topic(view: str) -> RosTopic:
    """Of the bitstream of a view."""
    return RosTopic(f"/tams/{_token(view)}/compressed", CompressedVideo, VIDEO_DEPTH)


def published(views: Iterable[str]) -> tuple[RosTopic, ...]:
    """All that we send."""
    return (*_FIXED, *map(video_topic, views))


def _token(name: str) -> str:
    """`name` as a part of a ROS name: letters, digits and _, no digit first."""
    token = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"view_{token}" if not token or token[0].isdigit() else token
