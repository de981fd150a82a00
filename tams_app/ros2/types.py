"""Message types of ROS 2 beside their bytes: the definition and its hash.

From rosbags, which brings the definitions of ROS 2's own packages.
"""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

# of foxglove_msgs, which is no part of ROS itself
_COMPRESSED_VIDEO = """
builtin_interfaces/Time timestamp
string frame_id
uint8[] data
string format
"""


@cache
def typestore() -> Typestore:
    """ROS 2 Humble's types (the fields of ours are the same in every later release) and ours."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_COMPRESSED_VIDEO, "foxglove_msgs/msg/CompressedVideo"))
    return store


def type_hash(ros_name: str) -> str:
    """RIHS01 (REP 2011), by which nodes since ROS 2 Iron distinguish versions of a type."""
    return typestore().hash_rihs01(ros_name)
