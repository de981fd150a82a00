"""The messages of ROS 2 that we send and receive, as DDS types: fields, order and names are ROS's.

A field's unit and frame are what its ROS definition says: metres, radians, seconds. The names are
those that ROS 2 gives its types on DDS. No `from __future__ import annotations`: cyclonedds reads
the annotations, and cannot read a sequence from text.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, TypeAlias, TypeVar, dataclass_transform

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import byte, float64, int32, sequence, uint8, uint32
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tams_app.units import NS_PER_S

Strings: TypeAlias = Annotated[Sequence[str], sequence(str)]
Numbers: TypeAlias = Annotated[Sequence[float], sequence(float64)]
Octets: TypeAlias = Annotated[Sequence[int], sequence(uint8)]  # `bytes` is one

M = TypeVar("M", bound=type[IdlStruct])


@dataclass_transform()
def _message(kind: M) -> M:
    return dataclass(final(kind))  # type: ignore[return-value]


@_message
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32

    @staticmethod
    def of(wall_ns: int) -> "Time":
        """Nanoseconds since 1970."""
        return Time(*divmod(wall_ns, NS_PER_S))


@_message
class HeaderMsg(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@_message
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@_message
class Empty(IdlStruct, typename="std_msgs::msg::dds_::Empty_"):
    structure_needs_at_least_one_member: uint8 = 0  # so called by ROS, as DDS knows no empty type


@_message
class MultiArrayDimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@_message
class MultiArrayLayout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: Annotated[Sequence[MultiArrayDimension], sequence(MultiArrayDimension)]
    data_offset: uint32


@_message
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: MultiArrayLayout
    data: Numbers


@_message
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@_message
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@_message
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@_message
class PoseMsg(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@_message
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: HeaderMsg
    pose: PoseMsg


@_message
class TwistMsg(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@_message
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: HeaderMsg
    twist: TwistMsg


@_message
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@_message
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: HeaderMsg
    child_frame_id: str
    transform: Transform


@_message
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: Annotated[Sequence[TransformStamped], sequence(TransformStamped)]


@_message
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: HeaderMsg
    name: Strings
    position: Numbers
    velocity: Numbers
    effort: Numbers


@_message
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@_message
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: byte
    name: str
    message: str
    hardware_id: str
    values: Annotated[Sequence[KeyValue], sequence(KeyValue)]


@_message
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: HeaderMsg
    status: Annotated[Sequence[DiagnosticStatus], sequence(DiagnosticStatus)]


@_message
class CompressedVideo(IdlStruct, typename="foxglove_msgs::msg::dds_::CompressedVideo_"):
    timestamp: Time
    frame_id: str
    data: Octets
    format: str


def ros_name(message: type[IdlStruct]) -> str:
    """The name of a type in ROS 2, such as `geometry_msgs/msg/PoseStamped`."""
    return message.__idl_typename__.replace("::msg::dds_::", "/msg/").removesuffix("_")


def cdr(message: IdlStruct) -> bytes:
    """As ROS 2 has it on the wire and in bags: little-endian CDR (XCDR1) with its header."""
    return message.serialize(use_version_2=False)


# of foxglove_msgs, which is no part of ROS itself
_COMPRESSED_VIDEO = """
builtin_interfaces/Time timestamp
string frame_id
uint8[] data
string format
"""


@cache
def typestore() -> Typestore:
    """The definitions of the types beside our bytes, from rosbags, which brings those of ROS 2.

    Of ROS 2 Humble (the fields of ours are the same in every later release), and ours.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_COMPRESSED_VIDEO, "foxglove_msgs/msg/CompressedVideo"))
    return store


def type_hash(ros_name: str) -> str:
    """RIHS01 (REP 2011), by which nodes since ROS 2 Iron distinguish versions of a type."""
    return typestore().hash_rihs01(ros_name)
