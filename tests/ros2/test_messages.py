"""The bytes of our messages are ROS 2's: rosbags reads them by the same definitions."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import byte, float64, int32, uint8, uint32
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tams_app.ros2 import messages
from tams_app.ros2.conversion import RATES
from tams_app.ros2.messages import (
    STOP,
    RosTopic,
    cdr,
    published,
    ros_name,
    type_hash,
    typestore,
    video_topic,
)

pytestmark = pytest.mark.untimed

MESSAGES = [
    one
    for _, one in inspect.getmembers(messages, inspect.isclass)
    if issubclass(one, IdlStruct) and one is not IdlStruct
]
SCALARS: dict[Any, st.SearchStrategy[Any]] = {
    str: st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20),
    byte: st.integers(0, 127),  # rosbags packs it as signed; levels of diagnostics are 0 to 3
    uint8: st.integers(0, 255),
    uint32: st.integers(0, 2**32 - 1),
    int32: st.integers(-(2**31), 2**31 - 1),
    float64: st.floats(),
}


def values(hint: Any) -> st.SearchStrategy[Any]:
    """Of a field's type."""
    if hint in SCALARS:
        return SCALARS[hint]
    if get_origin(hint) is Annotated:
        element = get_args(hint)[1].subtype
        if element == uint8:
            return st.binary(max_size=50)
        return st.lists(values(element), max_size=4)
    parts = get_type_hints(hint, include_extras=True)
    return st.builds(hint, **{one.name: values(parts[one.name]) for one in fields(hint)})


def test_there_are_messages() -> None:
    assert len(MESSAGES) == 22


@pytest.mark.parametrize("message", MESSAGES, ids=ros_name)
@given(data=st.data())
def test_the_bytes_of_every_message_are_those_of_ros(
    message: type[IdlStruct], data: st.DataObject
) -> None:
    ours = cdr(data.draw(values(message)))
    theirs = typestore().deserialize_cdr(ours, ros_name(message))
    assert bytes(typestore().serialize_cdr(theirs, ros_name(message))) == ours


def test_dds_knows_topics_and_types_by_the_names_that_ros_gives_them() -> None:
    topic = next(one for one in published(()) if one.name == "/tams/tcp_pose")
    assert topic.dds_name == "rt/tams/tcp_pose"
    assert topic.type.__idl_typename__ == "geometry_msgs::msg::dds_::PoseStamped_"


@pytest.mark.parametrize(
    "release", [Stores.ROS2_HUMBLE, Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED]
)
def test_the_types_are_the_same_in_the_releases_of_ros(release: Stores) -> None:
    store = get_typestore(release)
    for topic in (*published(()), STOP):
        name = ros_name(topic.type)
        assert store.hash_rihs01(name) == type_hash(name)


@pytest.mark.parametrize(
    ("view", "name"), [("eih", "eih"), ("left-top", "left_top"), ("2nd", "view_2nd"), ("ü", "_")]
)
def test_a_view_s_topic_has_a_name_that_ros_takes(view: str, name: str) -> None:
    assert video_topic(view) == RosTopic(
        f"/tams/{name}/compressed", messages.CompressedVideo, depth=30
    )


def test_the_document_has_every_topic_as_it_is() -> None:
    text = (Path(__file__).parents[2] / "docs" / "ROS2.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(/[\w/<>]+)` \| (\S+) \|.*\| ([\w ]+), (\d+) \|$", text, re.MULTILINE)
    told = {name: (kind, durability, int(depth)) for name, kind, durability, depth in rows}
    assert told == {
        topic.name.replace("/eih/", "/<view>/"): (
            ros_name(topic.type),
            "transient local" if topic.latched else "volatile",
            topic.depth,
        )
        for topic in published(("eih",))
    }
    assert f"| `{STOP.name}` | {ros_name(STOP.type)} |" in text
    assert ", ".join(f"`{name}`" for name in RATES) in " ".join(text.split())
