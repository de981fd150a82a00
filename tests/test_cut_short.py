"""Sessions as a user starts them that are cut short."""

import signal
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from tams_app.recording import read_log
from tams_app.records import Activity
from tams_app.ros2.messages import Empty
from tests.faults import applications as faults
from tests.further import further
from tests.ros2.dds import LOOPBACK, RELIABLE, Node, free_domain, until

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(180),
]


@contextmanager
def session_in(folder, *options):
    """A session that has got as far as to move the arm."""
    with faults.Application(folder, words=("run", "--arm", *options)) as session:
        session.says("engaged")
        session.note_helpers()
        yield session


def ended(session):
    """Exit code, words on stderr and the log, once it has ended."""
    return *session.ends(), faults.only_log(session.out)


@pytest.fixture
def running(tmp_path):
    with session_in(tmp_path) as session:
        yield session


@pytest.mark.verify
def test_a_session_hears_the_emergency_stop_of_ros_2_and_outlives_its_bridge(tmp_path, monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    domain = free_domain()
    with session_in(tmp_path, "--ros2", str(domain)) as running:
        writer = Node(domain).stop_writer(RELIABLE)
        until(lambda: len(writer.get_matched_subscriptions()) == 2)
        writer.write(Empty(0))
        running.says("fault, emergency stop")
        children = psutil.Process(running.process.pid).children(recursive=True)
        (bridge,) = (one for one in children if "tams_app.session.ros2_process" in one.cmdline())
        bridge.kill()
        running.says("the ROS 2 bridge has ended")
        running.process.send_signal(signal.SIGINT)
        code, _, log = ended(running)
    assert code == 130
    assert log.ticks[-1].reason == "emergency stop"
    assert log.ticks[-1].arm.activity is Activity.STOPPED
    assert any("emergency stop, asked for in ROS 2" in note.text for note in log.notes)


def ends_in_order(session, number):
    """The log of a session that this signal ends."""
    session.process.send_signal(number)
    code, words, log = ended(session)
    assert code == 130
    assert words.startswith(f"tams: ended by {number.name}; all that was recorded is in ")
    assert len(words.splitlines()) == 1
    assert not log.truncated
    assert log.outcome.reason == f"ended by {number.name}"
    return log


@pytest.mark.verify
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_session_ends_in_order(running, number):
    ends_in_order(running, number)


def test_the_emergency_stop_signal_stops_the_arm_and_the_session_goes_on_until_it_is_interrupted(
    running,
):
    running.process.send_signal(signal.SIGUSR1)
    running.says("fault, emergency stop")
    (path,) = running.out.glob("*/session.mcap")
    faults.until(lambda: read_log(path).stops, "the stop's record on disk")
    log = ends_in_order(running, signal.SIGINT)
    assert log.ticks[-1].arming == "fault"
    assert log.ticks[-1].reason == "emergency stop"
    assert log.ticks[-1].arm.activity is Activity.STOPPED
    (stop,) = log.stops
    assert stop.reason == "emergency stop"
    assert stop.stopped_ns is not None


@pytest.mark.parametrize("name", ["rig", *further("renderer", "relay", "guard", "operator")])
def test_a_killed_helper_stops_the_arm_and_ends_the_session_with_a_sentence(running, name):
    running.helper(name).kill()
    code, words, log = ended(running)
    assert code == 1
    assert len(words.strip().splitlines()) == 1
    assert words.startswith("tams: ")
    assert not log.truncated
    assert log.outcome.completed is False
    assert all(tick.twist.is_zero for tick in log.ticks[-2:])
    assert log.ticks[-1].arming == "fault"
    if name != "rig":  # which is the arm
        assert log.ticks[-1].arm.activity is Activity.STOPPED
        assert log.stops


def test_a_killed_session_leaves_a_readable_log_and_no_process(running):
    (path,) = running.out.glob("*/session.mcap")
    faults.until(lambda: len(read_log(path).ticks) >= 100, "100 ticks on disk")
    running.process.kill()
    code, _, log = ended(running)
    assert code == -signal.SIGKILL
    left = f"tams-{running.process.pid}-*"
    faults.until(lambda: not list(Path("/dev/shm").glob(left)), "its shared memory to go", 20.0)
    assert log.truncated
    assert len(log.ticks) >= 100
