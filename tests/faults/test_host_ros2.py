"""The bridge to ROS 2 while the arm moves: it may stop the arm, and can do nothing else to it."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tams_app.ros2.messages import Empty
from tams_app.session.ros2_bridge import Ros2Bridge
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.promises import is_logged, is_stopped, recovers_from_fault
from tests.faults.virtual_bench import VirtualBench
from tests.ros2.dds import LOOPBACK, RELIABLE, Node, free_domain, until
from tests.ros2.records import full_header

pytestmark = pytest.mark.waiting


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    return free_domain()


@pytest.fixture
def notes() -> list[str]:
    """What is noted of the bridge."""
    return []


@pytest.fixture
def bridge(
    virtual_bench: VirtualBench, domain: int, tmp_path: Path, notes: list[str]
) -> Iterator[Ros2Bridge]:
    """Beside the bench, whose signals it may set."""
    with ExitStack() as stack:
        bench = virtual_bench
        made = Ros2Bridge(domain, full_header(), bench.clock, tmp_path)
        stack.callback(made.end)
        stack.callback(made.stop_listening)
        made.listen(bench.signals.estop, lambda level, text: notes.append(text))
        yield made


def test_an_emergency_stop_in_ros_2_stops_the_arm_until_the_operator_confirms(
    virtual_bench: VirtualBench, domain: int, bridge: Ros2Bridge, notes: list[str]
) -> None:
    virtual_bench.engage_and_move()
    writer = Node(domain).stop_writer(RELIABLE)
    until(lambda: bool(notes), meanwhile=lambda: writer.write(Empty(0)))
    seen = virtual_bench.next
    bridge.stop_listening()  # what was sent besides until it was heard would stop it again
    is_stopped(virtual_bench, seen, Reason.EMERGENCY_STOP)
    assert notes == ["emergency stop, asked for in ROS 2 (/tams/emergency_stop)"]
    recovers_from_fault(virtual_bench)
    is_logged(virtual_bench, Reason.EMERGENCY_STOP)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_a_bridge_that_is_gone_or_stands_still_does_not_touch_the_arm(
    virtual_bench: VirtualBench, bridge: Ros2Bridge, notes: list[str], number: signal.Signals
) -> None:
    virtual_bench.engage_and_move()
    assert bridge.pid is not None
    os.kill(bridge.pid, number)
    if number is signal.SIGKILL:
        until(lambda: bool(notes))
        assert "the session goes on without it" in notes[0]
    first = virtual_bench.next
    for _ in range(12):
        virtual_bench.tick()
        bridge.receive(virtual_bench.ticks[-1])
    assert {output.arming for output in virtual_bench.outputs[first:]} == {ArmingState.ENGAGED}
    assert virtual_bench.travel_m(first) > 0.001
