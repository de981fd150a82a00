"""Records reach the bridge's process as they are, and become frames, stamps, names and numbers."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tams_app.records import Allocation, Note, Phase, Pose, Twist
from tams_app.ros2 import messages
from tams_app.ros2.conversion import RATES, Conversion
from tams_app.ros2.wire import decode, encode
from tams_app.rotation import Rotation
from tams_app.session.viewing import scene_of_header
from tams_app.teleop.hands import HANDS
from tams_app.teleop.reasons import Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.ros2.records import T_NS, frame, full_header, one_of_each, rates, truth
from tests.synthetic_session import VIEWS, Synthetic, header, tick

pytestmark = pytest.mark.untimed

OFFSET_NS = header().wall_offset_ns


@pytest.fixture
def conversion() -> Conversion:
    made = full_header()
    return Conversion(made, scene_of_header(made))


def only(sent: Any, topic: messages.RosTopic) -> Any:
    (found,) = [one.message for one in sent if one.topic == topic]
    return found


def wall_ns(stamp: Any) -> int:
    assert 0 <= stamp.nanosec < NS_PER_S
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


def pose_of(transform: Any) -> Pose:
    at, turn = transform.translation, transform.rotation
    return Pose(np.array([at.x, at.y, at.z]), Rotation(turn.x, turn.y, turn.z, turn.w))


def test_a_tick_is_the_command_and_the_arm_s_report_each_at_its_time(
    conversion: Conversion,
) -> None:
    one = replace(tick(5), twist=Twist((0.1, -0.2, 0.3), (0.4, 0.5, -0.6)))
    sent = list(conversion.of(one))
    pose, joints, twist = (
        only(sent, topic) for topic in (messages.TCP_POSE, messages.JOINTS, messages.TWIST)
    )
    for message, t_ns in ((pose, one.arm.received_ns), (twist, one.started_ns)):
        assert message.header.frame_id == "base_link"
        assert wall_ns(message.header.stamp) == t_ns + OFFSET_NS
    at, turn = pose.pose.position, pose.pose.orientation
    assert (at.x, at.y, at.z) == tuple(one.arm.tcp.position)
    assert (turn.x, turn.y, turn.z, turn.w) == tuple(one.arm.tcp.rotation)
    assert joints.name == [f"joint{number}" for number in range(1, 7)]
    assert joints.position == one.arm.joints.tolist()
    assert (joints.velocity, joints.effort) == ([], [])
    linear, angular = twist.twist.linear, twist.twist.angular
    assert (linear.x, linear.y, linear.z) == (0.1, -0.2, 0.3)
    assert (angular.x, angular.y, angular.z) == (0.4, 0.5, -0.6)


def test_a_report_is_sent_once_and_the_command_in_every_tick(conversion: Conversion) -> None:
    one = tick(5)
    again = replace(one, started_ns=one.started_ns + 8 * NS_PER_MS)
    first, second = ([sent.topic for sent in conversion.of(each)] for each in (one, again))
    assert messages.TCP_POSE in first
    assert second == [messages.TWIST]


def test_without_an_arm_there_is_no_pose(conversion: Conversion) -> None:
    found = {sent.topic for sent in conversion.of(replace(tick(5), arm=None))}
    assert found == {messages.TWIST, messages.DIAGNOSTICS}


def test_every_frame_hangs_on_the_base_and_a_camera_s_looks_along_z(
    conversion: Conversion,
) -> None:
    still = only(conversion.opening(), messages.TF_STATIC).transforms
    moved = only(conversion.of(tick(5)), messages.TF).transforms
    things = only(conversion.of(truth()), messages.TF).transforms
    parents = {one.child_frame_id: one.header.frame_id for one in (*still, *moved, *things)}
    assert parents == {
        **dict.fromkeys(("tcp", *(f"link{number}" for number in range(1, 7))), "base_link"),
        **dict.fromkeys(("tracking", "gt_optical", "gs_optical"), "base_link"),
        **dict.fromkeys(("block", "container"), "base_link"),
        "eih_optical": "link6",
    }
    seen_from_above = {one.child_frame_id: pose_of(one.transform) for one in still}["gt_optical"]
    assert seen_from_above.rotation.apply(np.array([0.0, 0.0, 1.0]))[2] < -0.5


def test_frames_are_sent_thirty_times_a_second_and_reports_as_they_come(
    conversion: Conversion,
) -> None:
    sent = [one.topic for number in range(241) for one in conversion.of(tick(number))]
    assert sent.count(messages.JOINTS) == sent.count(messages.TCP_POSE) == 241
    assert 59 <= sent.count(messages.TF) <= 61


def test_without_the_scene_the_tcp_is_placed_and_nothing_more() -> None:
    conversion = Conversion(header(), None)
    assert list(conversion.opening()) == []
    (only_frame,) = only(conversion.of(tick(5)), messages.TF).transforms
    assert only_frame.child_frame_id == "tcp"


def test_rates_are_a_table_whose_labels_name_rows_and_columns(conversion: Conversion) -> None:
    message = only(conversion.of(rates()), messages.RATES)
    rows, columns = message.layout.dim
    names = rows.label.split(",")
    assert names == [*VIEWS, "all"]
    assert columns.label.split(",") == list(RATES)
    assert (rows.size, rows.stride) == (4, 4 * len(RATES))
    assert (columns.size, columns.stride) == (len(RATES), len(RATES))
    table = np.reshape(message.data, (rows.size, columns.size))

    def value(row: str, column: str) -> float:
        return float(table[names.index(row), RATES.index(column)])

    assert value("gt", "target_kbps") == 1001.0
    assert value("gs", "latency_ms") == 61.0
    assert value("all", "capacity_kbps") == 6000.0
    assert value("all", "queue_ms") == 12.5
    assert (message.data[15], message.data[53]) == (990.5, 6000.0)  # as docs/ROS2.md says
    for row, column in (("eih", "received_ssim"), ("all", "loss"), ("all", "shown_fps")):
        assert math.isnan(value(row, column))  # not measured, or not of this row
    assert math.isnan(value("eih", "budget_kbps"))


def test_video_is_the_bitstream_with_the_time_of_capture(conversion: Conversion) -> None:
    (sent,) = conversion.of(frame("gs"))
    assert sent.topic == messages.video_topic("gs")
    video: Any = sent.message
    assert (video.format, video.frame_id, video.data) == ("h264", "gs_optical", frame().data)
    assert wall_ns(video.timestamp) == T_NS + OFFSET_NS
    assert sent.wall_ns == frame().encoded_ns + OFFSET_NS


@pytest.mark.parametrize(
    ("arming", "reason", "level"),
    [
        ("disarmed", "", 0),
        ("engaged", "", 0),
        ("holding", Reason.STALE_VIDEO.label, 1),
        ("fault", Reason.EMERGENCY_STOP.label, 2),
    ],
)
def test_diagnostics_say_why_the_arm_does_not_move_and_what_helps(
    conversion: Conversion, arming: str, reason: str, level: int
) -> None:
    message = only(
        conversion.of(replace(tick(5), arming=arming, reason=reason)), messages.DIAGNOSTICS
    )
    (status,) = message.status
    assert (status.level, status.name, status.hardware_id) == (level, "TAMS: arm", "lite6")
    assert status.message.startswith(arming)
    if reason:
        (known,) = [one for one in Reason if one.label == reason]
        assert status.message == f"{arming}, {reason}. {known.sentence(HANDS['openvr'])}"
    values = {one.key: one.value for one in status.values}
    assert (values["arming"], values["reason"]) == (arming, reason)
    assert (values["phase"], values["gripper"]) == ("REACH", "unknown")


def test_diagnostics_come_with_every_change_and_once_a_second(conversion: Conversion) -> None:
    ticks = [tick(number) for number in range(240)]
    ticks[50] = replace(ticks[50], arming="fault", reason="emergency stop")
    sent = [one for each in ticks for one in conversion.of(each)]
    told = [one for one in sent if one.topic == messages.DIAGNOSTICS]
    assert len(told) == 2 + 2  # at 0 and 1 s; the change, and the one back


def test_sentences_are_diagnostics_with_their_level(conversion: Conversion) -> None:
    for level, expected in (("info", 0), ("warning", 1), ("error", 2)):
        message = only(conversion.of(Note(T_NS, level, "a sentence")), messages.DIAGNOSTICS)
        (status,) = message.status
        assert (status.level, status.message) == (expected, "a sentence")


def test_the_authors_topics_and_words_are_there_in_their_dialect_alone() -> None:
    targets = {"eih": 3192, "gt": 1164, "gs": 1164}
    given = Allocation(T_NS, Phase.PRE_RELEASE, 6000.0, 5520.0, targets)
    assert [*Conversion(full_header(), None).of(given)] == []
    theirs = full_header(**{"ros2.dialect": "reference"})
    phase, bits = Conversion(theirs, None).of(given)
    assert (phase.topic.name, bits.topic.name) == ("/tams/phase", "/tams/bitrate_targets")
    assert phase.wall_ns == bits.wall_ns == T_NS + OFFSET_NS
    assert phase.message.data == "Pre-release"
    assert json.loads(bits.message.data) == {
        "phase": "Pre-release",
        "targets_mbps": {"EIH": 3.192, "GT": 1.164, "GS": 1.164},
    }


def test_by_default_nothing_of_ours_has_a_name_of_theirs() -> None:
    theirs = {topic.name for topic in messages.AUTHORS}
    assert not theirs & {topic.name for topic in messages.published(VIEWS)}
    assert {phase.word for phase in Phase} == {
        *("Reach", "Align", "Grasp", "Transport", "Pre-release", "Release")
    }


@pytest.mark.parametrize(
    "record",
    [full_header(), *one_of_each(), replace(tick(0), arm=None)],
    ids=lambda one: type(one).__name__,
)
def test_a_record_is_the_same_after_its_way(record: Any) -> None:
    content = encode(record)
    again = decode(memoryview(content))
    assert type(again) is type(record)
    assert encode(again) == content  # tests/test_codec.py: a record's JSON has all of it


def test_what_ros_is_not_told_of_is_not_sent() -> None:
    log = Synthetic(0.1).log()
    for record in (log.captured[0], log.shown[0], log.system[0]):
        assert encode(record) is None
