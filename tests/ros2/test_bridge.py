"""The bridge, with DDS: what nodes hear, what stops the arm, and that nothing waits for it."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from tams_app.config import load_config
from tams_app.errors import SetupError
from tams_app.recording import LOG_NAME, Recorder, read_log
from tams_app.records import Phase, PhaseChange
from tams_app.robot.control import Signals
from tams_app.ros2.messages import (
    JOINTS,
    PHASE,
    STOP,
    TCP_POSE,
    TF_STATIC,
    Empty,
    published,
    ros_name,
    type_hash,
    video_topic,
)
from tams_app.ros2.participant import DdsParticipant
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.mailbox import Sentences
from tams_app.session.recorders import live_records
from tams_app.session.ros2_bridge import Ros2Bridge
from tams_app.units import NS_PER_S
from tests.ros2.dds import (
    BEST_EFFORT,
    LOOPBACK,
    RELIABLE,
    Node,
    free_domain,
    heard_until,
    until,
)
from tests.ros2.records import T_NS, frame, full_header, one_of_each
from tests.synthetic_session import VIEWS, never_fails, tick

pytestmark = pytest.mark.waiting


@pytest.fixture(scope="module", autouse=True)
def _on_loopback() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CYCLONEDDS_URI", LOOPBACK)
        yield


@contextmanager
def bridge_in(domain: int, folder: Path) -> Iterator[Ros2Bridge]:
    with ExitStack() as stack:
        made = Ros2Bridge(domain, full_header(), MonotonicClock(), folder)
        stack.callback(made.end)
        stack.callback(made.stop_listening)
        yield made


@pytest.fixture
def domain() -> int:
    return free_domain()


@pytest.fixture
def bridge(domain: int, tmp_path: Path) -> Iterator[Ros2Bridge]:
    with bridge_in(domain, tmp_path) as made:
        yield made


@pytest.fixture(scope="module")
def published_in(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, Ros2Bridge]]:
    """A domain with a bridge that is only told records, for all tests of what nodes get."""
    domain = free_domain()
    with bridge_in(domain, tmp_path_factory.mktemp("bridge")) as made:
        yield domain, made


class Heard:
    """What the bridge tells the session."""

    def __init__(self, bridge: Ros2Bridge) -> None:
        self.signals = Signals()
        self.notes: list[str] = []
        bridge.listen(self.signals.estop, lambda level, text: self.notes.append(text))

    @property
    def stopped(self) -> bool:
        return self.signals.take(0).estop


def test_a_node_finds_every_topic_with_its_type_and_quality_of_service(
    published_in: tuple[int, Ros2Bridge],
) -> None:
    domain, _ = published_in
    topics = {topic.dds_name: topic for topic in published(VIEWS)}
    for name, offered in Node(domain).offered(set(topics)).items():
        topic = topics[name]
        assert offered.type_name == topic.type.__idl_typename__
        qos = {one.__scope__: str(one) for one in offered.qos}
        assert "Reliable" in qos["Reliability"]
        assert ("TransientLocal" in qos["Durability"]) == topic.latched
        assert type_hash(ros_name(topic.type)) in qos["Userdata"]
        assert "use_xcdrv2_representation=False" in qos["DataRepresentation"]


def test_a_node_hears_every_record_that_ros_is_told_of(
    published_in: tuple[int, Ros2Bridge],
) -> None:
    domain, bridge = published_in
    node = Node(domain)
    readers = {topic: node.reader(topic) for topic in published(VIEWS)}
    heard: dict[Any, list[Any]] = {topic: [] for topic in readers}
    number = 0

    def tell() -> None:
        nonlocal number
        number += 1
        for record in (tick(number * 120), *one_of_each()):
            bridge.receive(record)

    def all_heard() -> bool:
        for topic, reader in readers.items():
            heard[topic] += reader.take(100)
        return all(heard.values())

    until(all_heard, meanwhile=tell)
    assert heard[PHASE][0].data == "ALIGN"
    assert heard[JOINTS][0].name == [f"joint{number}" for number in range(1, 7)]
    assert heard[TCP_POSE][0].header.frame_id == "base_link"
    assert bytes(heard[video_topic("gs")][0].data) == frame().data


def test_a_node_that_comes_later_knows_the_phase_and_the_frames_that_stand_still(
    published_in: tuple[int, Ros2Bridge],
) -> None:
    domain, bridge = published_in
    first = Node(domain).reader(PHASE)
    for phase in (Phase.REACH, Phase.RELEASE):
        bridge.receive(PhaseChange(T_NS, phase, "test"))
    # so that it was published before the next node comes
    heard_until([first], lambda heard: any(one.data == "RELEASE" for one in heard))
    late = Node(domain)
    readers = [late.reader(topic) for topic in (PHASE, TF_STATIC)]
    found = heard_until(readers, lambda heard: len(heard) >= 2)
    assert {type(one).__name__ for one in found} == {"String", "TFMessage"}
    assert [one.data for one in found if hasattr(one, "data")] == ["RELEASE"]


def test_the_emergency_stop_of_any_publisher_stops(domain: int, bridge: Ros2Bridge) -> None:
    """DDS lets who takes best effort take a reliable publisher too, as the next tests' is."""
    heard = Heard(bridge)
    writer = Node(domain).stop_writer(BEST_EFFORT)
    until(lambda: heard.stopped, meanwhile=lambda: writer.write(Empty(0)))
    until(lambda: bool(heard.notes))
    assert heard.notes[0] == "emergency stop, asked for in ROS 2 (/tams/emergency_stop)"


def test_a_publisher_that_leaves_does_not_stop_a_second_time(domain: int) -> None:
    participant, node = DdsParticipant(domain, ()), Node(domain)
    witness, writer = node.reader(STOP), node.stop_writer(RELIABLE)
    until(lambda: participant.stop_asked(0), meanwhile=partial(writer.write, Empty(0)))
    until(lambda: not participant.stop_asked(NS_PER_S) and not witness.take(1000))
    del writer
    gc.collect()  # it is part of a cycle
    heard_until([witness], lambda heard: any(not isinstance(one, Empty) for one in heard))
    assert not participant.stop_asked(NS_PER_S)


def test_a_publisher_that_says_nothing_stops_nothing(
    published_in: tuple[int, Ros2Bridge],
) -> None:
    domain, bridge = published_in
    heard = Heard(bridge)
    node = Node(domain)
    joints = node.reader(JOINTS)
    writer = node.stop_writer(RELIABLE)
    numbers = iter(range(1, 10_000))
    until(lambda: bool(joints.take(1)), lambda: bridge.receive(tick(next(numbers))))
    del writer  # comes and goes
    gc.collect()
    until(lambda: bool(joints.take(1)), lambda: bridge.receive(tick(next(numbers))))
    assert not heard.stopped
    assert heard.notes == []
    bridge.stop_listening()


def test_a_bridge_that_stands_still_holds_up_nothing_and_goes_on_afterwards(
    domain: int, bridge: Ros2Bridge
) -> None:
    heard, node = Heard(bridge), Node(domain)
    joints = node.reader(JOINTS)
    numbers = iter(range(1, 1_000_000))
    until(lambda: bool(joints.take(1)), lambda: bridge.receive(tick(next(numbers))))
    os.kill(bridge.pid, signal.SIGSTOP)
    try:
        while bridge.dropped < 1000:
            bridge.receive(tick(next(numbers)))
        until(lambda: bool(heard.notes))
    finally:
        os.kill(bridge.pid, signal.SIGCONT)
    assert heard.notes == ["the ROS 2 bridge is too slow: records are missing in ROS 2"]
    until(lambda: not joints.take(1000))
    until(lambda: bool(joints.take(1)), lambda: bridge.receive(tick(next(numbers))))


def test_a_frame_that_is_too_long_for_the_socket_is_left_out(
    published_in: tuple[int, Ros2Bridge],
) -> None:
    _, bridge = published_in
    before = bridge.dropped
    bridge.receive(frame(data=bytes(8_000_000)))
    assert bridge.dropped == before + 1


def test_a_bridge_ends_when_it_is_told_to_though_records_keep_coming(bridge: Ros2Bridge) -> None:
    heard = Heard(bridge)
    numbers = iter(range(1, 1_000_000))
    process = psutil.Process(bridge.pid)
    process.terminate()
    until(lambda: bool(heard.notes), lambda: bridge.receive(tick(next(numbers))))


@contextmanager
def recorder(domain: int, folder: Path, signals: Signals) -> Iterator[Recorder]:
    """Of a session that publishes."""

    config = load_config(None, {"recording.ros2": domain, "recording.min_free_mb": 0})
    (folder / "helpers").mkdir()
    records = live_records(config, MonotonicClock(), folder, never_fails, Sentences(), signals)
    with records as (log, _):
        yield log


def bridge_processes() -> set[int]:
    """Of this process."""
    children = psutil.Process().children()
    return {one.pid for one in children if "ros2_process" in str(one.cmdline())}


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_log_is_whole_whatever_becomes_of_the_bridge(
    domain: int, tmp_path: Path, signal_number: signal.Signals
) -> None:
    before = bridge_processes()
    with recorder(domain, tmp_path, signals := Signals()) as log:
        (pid,) = bridge_processes() - before
        os.kill(pid, signal_number)
        for number in range(900):
            log.record(tick(number))
            if number % 100 == 0:
                time.sleep(0.05)  # the recorder's queue holds ten seconds, not a whole session
    kept = read_log(tmp_path / LOG_NAME)
    assert kept.complete
    assert len(kept.ticks) == 900
    assert not signals.take(0).estop
    told = [note.text for note in kept.notes]
    assert f"published in ROS 2, domain {domain}: all who reach it see this session" in told
    if signal_number is signal.SIGKILL:
        assert sum("the ROS 2 bridge has ended" in text for text in told) == 1
    assert not psutil.pid_exists(pid)


def test_a_log_tells_of_a_stop_that_ros_asked_for(domain: int, tmp_path: Path) -> None:
    with recorder(domain, tmp_path, signals := Signals()):
        writer = Node(domain).stop_writer(RELIABLE)
        until(lambda: signals.take(0).estop, meanwhile=lambda: writer.write(Empty(0)))
    notes = read_log(tmp_path / LOG_NAME).notes
    assert any("emergency stop, asked for in ROS 2" in note.text for note in notes)


def test_without_dds_it_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK.replace('"lo"', '"nosuch0"'))
    with pytest.raises(SetupError, match=r"ROS 2 cannot be reached in domain 7 .*CYCLONEDDS_URI"):
        Ros2Bridge(7, full_header(), MonotonicClock(), tmp_path)


def test_the_application_itself_loads_no_dds() -> None:
    load = (
        "import sys; sys.modules['cyclonedds'] = sys.modules['rosbags'] = None\n"
        "import tams_app.cli, tams_app.console.app\n"
        "import tams_app.session.robot, tams_app.session.operate\n"
    )
    subprocess.run([sys.executable, "-c", load], check=True, timeout=100)
