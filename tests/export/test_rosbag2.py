"""A log as a bag of ROS 2, read by rosbags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from tams_app.export.rosbag2 import write_bag
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Note
from tams_app.ros2.conversion import DIAGNOSTICS_HZ
from tams_app.ros2.messages import published
from tams_app.session.viewing import scene_of_header
from tests.export.conftest import Export
from tests.foxglove_messages import write_viewed_log
from tests.ros2.records import full_header, truth
from tests.synthetic_session import START_NS, VIEWS, live_records

pytestmark = pytest.mark.untimed

SECONDS = 3.0
VIDEO_BYTES = 500


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of three seconds with all kinds of records."""
    folder = tmp_path_factory.mktemp("20260101-100000-run")
    items = [Note(START_NS, "info", "ready"), truth(), *live_records(SECONDS, VIDEO_BYTES)]
    write_viewed_log(folder / LOG_NAME, items, head=full_header())
    return folder


@pytest.fixture(scope="module")
def bag(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags") / "bag"
    write_bag(session / LOG_NAME, folder, scene_of_header(full_header()))
    return folder


def messages(bag: Path, topic: str) -> Iterator[tuple[int, Any]]:
    with AnyReader([bag]) as reader:
        chosen = [one for one in reader.connections if one.topic == topic]
        for connection, wall_ns, data in reader.messages(chosen):
            yield wall_ns, reader.deserialize(data, connection.msgtype)


def counts_of(log: SessionLog) -> dict[str, int]:
    """How many messages each record of a log amounts to, where that is a matter of counting."""
    reports = {tick.arm.received_ns for tick in log.ticks if tick.arm is not None}
    frames = Counter(sent.view for sent in log.sent)
    return {
        "/tams/twist_cmd": len(log.ticks),
        "/tams/tcp_pose": len(reports),
        "/joint_states": len(reports),
        "/tams/task_phase": len(log.phases),
        "/tf_static": 1,
        **{f"/tams/{view}/compressed": frames[view] for view in VIEWS},
    }


def test_a_bag_has_every_record_of_the_log(session: Path, bag: Path) -> None:
    log = read_log(session / LOG_NAME)
    with AnyReader([bag]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        assert reader.message_count == sum(counts.values())
    expected = counts_of(log)
    assert {topic: counts[topic] for topic in expected} == expected
    assert expected["/tams/twist_cmd"] == 360
    assert expected["/tams/eih/compressed"] == 90
    assert counts["/tams/rates"] in (2, 3)
    at_least = SECONDS * DIAGNOSTICS_HZ + len(log.notes)
    assert at_least <= counts["/diagnostics"] <= at_least + 1
    assert 89 <= counts["/tf"] - len(log.scene) <= 91


def test_a_bag_is_mcap_with_the_definitions_of_its_messages(bag: Path) -> None:
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (about["version"], about["storage_identifier"]) == (8, "mcap")
    (name,) = about["relative_file_paths"]
    with (bag / name).open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        counted = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert header.profile == "ros2"
    assert {one.topic for one in summary.channels.values()} == {
        one.name for one in published(VIEWS)
    }
    assert {one.message_encoding for one in summary.channels.values()} == {"cdr"}
    assert all(one.encoding == "ros2msg" and one.data for one in summary.schemas.values())
    assert sum(counted.values()) == about["message_count"]


def test_every_topic_has_its_type_and_quality_of_service(bag: Path) -> None:
    topics = {topic.name: topic for topic in published(VIEWS)}
    with AnyReader([bag]) as reader:
        assert {one.topic for one in reader.connections} == set(topics)
        for one in reader.connections:
            (qos,) = one.ext.offered_qos_profiles
            assert qos.reliability is QosReliability.RELIABLE
            assert (qos.durability is QosDurability.TRANSIENT_LOCAL) == topics[one.topic].latched
            assert qos.depth == topics[one.topic].depth


def test_messages_have_the_log_s_wall_time(session: Path, bag: Path) -> None:
    log = read_log(session / LOG_NAME)
    offset_ns = log.header.wall_offset_ns
    for tick, (wall_ns, message) in zip(log.ticks, messages(bag, "/tams/twist_cmd"), strict=True):
        stamp = message.header.stamp
        assert wall_ns == stamp.sec * 1_000_000_000 + stamp.nanosec == tick.started_ns + offset_ns


def test_wrong_use_and_what_is_missing_is_one_sentence_and_leaves_no_bag(
    session: Path, tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*arguments: object, kind: str = "rosbag2") -> tuple[int, str]:
        code, _, error = export(*arguments, kind=kind)
        assert len(error.splitlines()) == 1
        return code, error

    (tmp_path / session.name).mkdir()
    (tmp_path / session.name / "notes.txt").write_text("mine")
    code, error = refused(session, "--out", tmp_path)
    assert (code, f"{tmp_path / session.name}: is there already" in error) == (2, True)
    assert (tmp_path / session.name / "notes.txt").read_text() == "mine"
    code, error = refused(session, "--out", tmp_path / session.name / "notes.txt")
    assert (code, "cannot be written" in error) == (1, True)
    other = tmp_path / "other"
    other.mkdir()
    (other / LOG_NAME).write_bytes(b"something else")
    code, error = refused(other)
    assert (code, "is not a TAMS session log" in error) == (2, True)
    assert [one.name for one in other.iterdir()] == [LOG_NAME]
    code, error = refused(session, kind="rosbag1")
    assert (code, "'rosbag1' is not one of rosbag2" in error) == (2, True)
    monkeypatch.setattr("tams_app.errors.find_spec", lambda name: None)
    code, error = refused(session)
    needs = "--format rosbag2 needs cyclonedds and rosbags: make extras"
    assert (code, needs in error) == (1, True)


def test_of_a_log_that_was_cut_off_the_bag_has_what_can_be_read(
    session: Path, tmp_path: Path
) -> None:
    cut = tmp_path / LOG_NAME
    whole = (session / LOG_NAME).read_bytes()
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    log = read_log(cut)
    assert not log.complete
    counts = write_bag(cut, tmp_path / "bag", scene_of_header(log.header))
    assert counts["/tams/twist_cmd"] == len(log.ticks)
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == sum(counts.values())


def test_several_sessions_are_a_bag_each_and_beside_their_logs_without_a_place(
    session: Path, tmp_path: Path, export: Export
) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
        (folder / LOG_NAME).write_bytes((session / LOG_NAME).read_bytes())
    code, out, _ = export(*folders, kind="rosbag2")
    assert code == 0
    assert [line.split(":")[0] for line in out.splitlines()] == [
        f"{one}/rosbag2" for one in folders
    ]
    assert all((one / "rosbag2" / "metadata.yaml").exists() for one in folders)
    with AnyReader([folders[0] / "rosbag2"]) as reader:
        assert reader.topics["/tf_static"].msgcount == 1, "the scene of the log's own header"
