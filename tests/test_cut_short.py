"""Sessions as a user starts them that are cut short."""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from tams_app.recording import read_log
from tams_app.records import Activity
from tams_app.ros2.messages import Empty
from tams_app.runtime.process import PROJECT_DIRECTORY
from tests.faults.applications import FPS, configuration_file
from tests.further import further
from tests.ros2.dds import LOOPBACK, RELIABLE, Node, free_domain, until
from tests.spoken import spoken

HELPERS = {
    "rig": "hw.sim.rig",
    "renderer": "hw.sim.world.renderer",
    "relay": "tams_app.video.live.relay",
    "guard": "hw.guard.process",
    "operator": "tams_app.station.operator_process",
    "ros2": "tams_app.session.ros2_process",
}
pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(180),
]


class Running:
    """A session that has got as far as to move the arm."""

    def __init__(self, out, *options):
        self.out = out / "logs"
        few_frames = {"video.fps": FPS, "video.quality.enabled": False}  # nothing is about them
        config = configuration_file(out, few_frames)
        self.process = subprocess.Popen(
            [
                *(sys.executable, "run_tams.py", "run", "--sim", "--arm", "--headless"),
                *("--operator", "scripted"),
                *("--config", str(config), "--out", str(self.out)),
                *options,
            ],
            cwd=PROJECT_DIRECTORY,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.wait_for("engaged")
        self.children = psutil.Process(self.process.pid).children(recursive=True)

    def wait_for(self, words):
        """Read what it says until a line begins so."""
        for line in self.process.stdout:
            if spoken(line).startswith(words):
                return
        raise AssertionError(f"it never said {words!r}")

    def helper(self, name):
        (found,) = (child for child in self.children if HELPERS[name] in child.cmdline())
        return found

    def wait_for_ticks(self, wanted):
        """How many ticks the log on disk holds, once they are `wanted`."""
        (path,) = self.out.glob("*/session.mcap")
        deadline = time.monotonic() + 60
        while (logged := len(read_log(path).ticks)) < wanted:
            assert time.monotonic() < deadline, f"only {logged} ticks on disk"
            time.sleep(0.2)
        return logged

    def end(self):
        """Exit code, words on stderr and the log, once everything has ended."""
        _, words = self.process.communicate(timeout=60)
        _, alive = psutil.wait_procs(self.children, timeout=20)
        zombies = [child for child in alive if child.status() == psutil.STATUS_ZOMBIE]
        assert len(alive) == len(zombies), f"left behind: {alive}"
        (folder,) = self.out.iterdir()
        return self.process.returncode, words, read_log(folder / "session.mcap")


@contextmanager
def session_in(folder, *options):
    session = Running(folder, *options)
    yield session
    if session.process.poll() is None:
        session.process.kill()
    session.process.communicate()


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
        writer.write(Empty())
        running.wait_for("fault, emergency stop")
        running.helper("ros2").kill()
        running.wait_for("the ROS 2 bridge has ended")
        running.process.send_signal(signal.SIGINT)
        code, _, log = running.end()
    assert code == 130
    assert log.ticks[-1].reason == "emergency stop"
    assert log.ticks[-1].arm.activity is Activity.STOPPED
    assert any("emergency stop, asked for in ROS 2" in note.text for note in log.notes)


@pytest.mark.parametrize("number", [signal.SIGINT, *further(signal.SIGTERM, signal.SIGHUP)])
def test_an_interrupted_session_ends_in_order(running, number):
    running.process.send_signal(number)
    code, words, log = running.end()
    assert code == 130
    assert words.startswith(f"tams: ended by {number.name}; all that was recorded is in ")
    assert len(words.splitlines()) == 1
    assert not log.truncated
    assert log.outcome.reason == f"ended by {number.name}"


def test_the_emergency_stop_signal_stops_the_arm_and_the_session_goes_on(running):
    running.process.send_signal(signal.SIGUSR1)
    running.wait_for("fault, emergency stop")
    running.process.send_signal(signal.SIGINT)
    code, _, log = running.end()
    assert code == 130
    assert log.ticks[-1].arming == "fault"
    assert log.ticks[-1].reason == "emergency stop"
    assert log.ticks[-1].arm.activity is Activity.STOPPED
    stop = log.stops[-1]
    assert stop.reason == "emergency stop"
    assert stop.stopped_ns is not None


@pytest.mark.parametrize("name", ["rig", *further("renderer", "relay", "guard", "operator")])
def test_a_killed_helper_stops_the_arm_and_ends_the_session_with_a_sentence(running, name):
    running.helper(name).kill()
    code, words, log = running.end()
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
    logged = running.wait_for_ticks(100)
    running.process.kill()
    code, _, log = running.end()
    assert code == -signal.SIGKILL
    assert not list(Path("/dev/shm").glob(f"tams-{running.process.pid}-*"))
    assert log.truncated
    assert len(log.ticks) >= logged
