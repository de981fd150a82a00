"""Wall time may jump: nothing moves differently, because nothing reads it.

A computer that was suspended is another matter: the clock that is read stood still meanwhile.
"""

from __future__ import annotations

import ast
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_S
from tests.faults.bench import ACROSS, PERIOD_NS
from tests.faults.promises import is_logged, is_stopped, recovers_from_fault
from tests.faults.virtual_bench import VirtualBench

pytestmark = pytest.mark.waiting

HOUR_S = 3600
PACKAGES = ("tams_app", "hw")
# Who may ask for wall time: the log's header, and the name of a session's folder.
MAY_ASK = {
    "tams_app/session/recorders.py",
    "tams_app/session/folder.py",
    "tams_app/study/runner.py",  # for the header of a virtual trial's log
    "tams_app/link/gateway.py",  # for the days that a certificate is valid
    "tams_app/link/page_server.py",
}
WALL = {
    "time": {"time", "time_ns", "localtime", "gmtime", "strftime", "ctime", "asctime"},
    "datetime": {"now", "utcnow", "today"},
}
CLOCKS = {"CLOCK_REALTIME", "CLOCK_TAI"}


class WallTime:
    """A wall clock that can be set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.offset_s = 0
        true_time, true_time_ns = time.time, time.time_ns
        monkeypatch.setattr(time, "time", lambda: true_time() + self.offset_s)
        monkeypatch.setattr(time, "time_ns", lambda: true_time_ns() + self.offset_s * NS_PER_S)


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> WallTime:
    return WallTime(monkeypatch)


def wire(between: Callable[[], None]) -> list[tuple[int, int, int, bytes]]:
    """Everything said to the arm in a session in which `between` happens while the arm moves."""
    bench = VirtualBench()
    bench.engage_and_move(0.4 * ACROSS)
    between()
    bench.run(0.3)
    bench.hand.trigger = 0.0
    between()
    bench.run(0.2)
    assert bench.outputs[-1].arming is ArmingState.READY
    bench.close()
    return [(each.tick, each.now_ns, each.register, each.payload) for each in bench.model.wire]


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S, -100 * 365 * 24 * HOUR_S], ids=str)
def test_a_jump_of_wall_time_changes_nothing_on_the_wire(wall: WallTime, jump_s: int) -> None:
    def jump() -> None:
        wall.offset_s += jump_s

    undisturbed = wire(lambda: None)
    before_s = time.time()
    assert wire(jump) == undisturbed
    assert abs(time.time() - before_s) > HOUR_S, "the clock did jump"


def test_the_clock_of_all_parts_does_not_follow_wall_time(wall: WallTime) -> None:
    clock = MonotonicClock()
    before_ns = clock.now_ns()
    wall.offset_s = -10 * HOUR_S
    assert 0 <= clock.now_ns() - before_ns < HOUR_S * NS_PER_S
    began_s = time.monotonic()
    clock.sleep_until_ns(clock.now_ns() + 20_000_000)
    assert 0.02 <= time.monotonic() - began_s < HOUR_S


def test_a_log_keeps_its_own_time_while_wall_time_jumps(tmp_path: Path, wall: WallTime) -> None:
    bench = VirtualBench(tmp_path)
    bench.engage_and_move()
    wall.offset_s = -HOUR_S
    bench.run(0.5)
    log = bench.read_back()
    starts = [tick.started_ns for tick in log.ticks]
    assert starts == [tick.started_ns for tick in bench.ticks]
    assert starts == sorted(starts)
    bench.close()


def wall_time_calls(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            yield from (alias.name for alias in node.names if alias.name in WALL["time"])
        if not isinstance(node, ast.Attribute):
            continue
        if node.attr in CLOCKS:
            yield node.attr
        owner = node.value
        name = owner.id if isinstance(owner, ast.Name) else getattr(owner, "attr", "")
        if node.attr in WALL.get(name, ()) or (name == "date" and node.attr == "today"):
            yield f"{name}.{node.attr}"


def test_only_headers_of_logs_names_of_folders_and_certificates_ask_for_wall_time() -> None:
    asking = {
        str(path.relative_to(PROJECT_DIRECTORY))
        for package in PACKAGES
        for path in sorted((PROJECT_DIRECTORY / package).rglob("*.py"))
        if any(wall_time_calls(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert asking == MAY_ASK


def test_the_first_tick_after_a_suspend_stops_the_arm(virtual_bench: VirtualBench) -> None:
    """Every sample and report looks fresh then, and the hand has long let go."""
    virtual_bench.engage_and_move()
    virtual_bench.suspend_s(HOUR_S)
    seen = virtual_bench.next
    is_stopped(virtual_bench, seen, Reason.COMPUTER_SLEPT)
    recovers_from_fault(virtual_bench)
    is_logged(virtual_bench, Reason.COMPUTER_SLEPT)


def test_a_pause_of_the_process_is_no_suspend(virtual_bench: VirtualBench) -> None:
    virtual_bench.engage_and_move()
    virtual_bench.tick(after_ns=4 * PERIOD_NS)
    assert virtual_bench.run(0.1).arming is ArmingState.ENGAGED
