"""How long and how far the arm moves on after a fault at full speed: `python -m benchmarks.faults`.

The controller is the model in a process of its own and is measured by its own joints, 250 times a
second; the application is the real control loop, driver and guard in another. Times begin just
before the signal that causes the fault is sent.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from benchmarks.fault_controller import CYCLE, CYCLES, EVENT, EVENTS, Kind, Trace
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig
from tams_app.printing import Console
from tams_app.runtime.process import HelperProcess

RESULTS = Path(__file__).parent / "results" / "faults.json"
REPETITIONS = 3
AT_MOST_MS, AT_MOST_DYING_MS = 100.0, 150.0
FULL_SPEED_M_S = 0.25
REST_M = 5e-5  # nearer than this to where it ends
SETTLE_S = 1.0
PATIENCE_S = 20.0
_STEADY_CYCLES = 12
_NEARLY = 0.98


@dataclass(frozen=True, slots=True)
class Scenario:
    """A fault, the process that gets the signal which causes it, and the time that is allowed."""

    name: str
    victim: str  # controller, application or guard
    signal: signal.Signals = signal.SIGUSR1
    at_most_ms: float = AT_MOST_MS


SCENARIOS = (
    Scenario("deadman released", "application"),
    Scenario("stale video", "application"),
    Scenario("arm error", "controller"),
    Scenario("reports frozen", "controller"),
    Scenario("no reply", "controller"),
    Scenario("emergency stop", "application"),
    Scenario("control loop stalled 200 ms", "application"),
    Scenario("application stopped (SIGSTOP)", "application", signal.SIGSTOP, AT_MOST_DYING_MS),
    Scenario("application killed (SIGKILL)", "application", signal.SIGKILL, AT_MOST_DYING_MS),
    Scenario("guard killed", "guard", signal.SIGKILL),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One fault, the worst of its repetitions; times from the fault on."""

    fault: str
    repetitions: int
    speed_mm_s: float  # at the fault
    zero_commanded_ms: float  # nothing in force at the controller asks for motion any more
    at_rest_ms: float
    travelled_mm: float
    at_most_ms: float  # for `zero_commanded_ms`

    @property
    def verdict(self) -> str:
        return "met" if self.zero_commanded_ms <= self.at_most_ms else "missed"


def measure(repetitions: int = REPETITIONS) -> list[Row]:
    """Every fault; some five seconds for each repetition."""
    return [_worst([measure_once(scenario) for _ in range(repetitions)]) for scenario in SCENARIOS]


def measure_once(scenario: Scenario) -> Row:
    """One fault, with processes of its own."""
    with tempfile.TemporaryDirectory(prefix="tams-faults-") as name, ExitStack() as stack:
        folder = Path(name)
        controller = HelperProcess(
            "controller",
            "benchmarks.fault_controller",
            {
                "trace": name,
                "fault": scenario.name,
                "start_joints_deg": ArmConfig().ready_joints_deg,
            },
            folder,
        )
        stack.callback(controller.stop)
        controller.start()
        ports = controller.wait_ready()
        application = HelperProcess(
            "application",
            "benchmarks.fault_application",
            {**ports, "fault": scenario.name, "folder": name},
            folder,
        )
        stack.callback(application.stop)
        application.start()
        facts = application.wait_ready()
        motion = Motion(folder)
        motion.await_full_speed()
        pids = {
            "controller": controller.pid,
            "application": application.pid,
            "guard": int(facts["guard_pid"]),
        }
        fault_ns = _send(scenario.signal, pids[scenario.victim])
        time.sleep(SETTLE_S)
        if scenario.signal is signal.SIGSTOP:  # what is stopped does not hear that it shall end
            _send(signal.SIGKILL, pids[scenario.victim])
        return motion.row(scenario, fault_ns)


class Motion:
    """What the controller has kept so far."""

    def __init__(self, folder: Path) -> None:
        self._cycles = Trace(folder / CYCLES, CYCLE, "r").rows
        self._events = Trace(folder / EVENTS, EVENT, "r").rows
        config = ArmConfig()
        self._deadman_ns = round(config.velocity_deadman_s * 1e9)
        self._model = Lite6Model(offset_from_mm_deg(config.tcp_offset_mm_deg))

    def await_full_speed(self) -> None:
        """Return when the arm has moved steadily at full speed for a while."""
        deadline_s = time.monotonic() + PATIENCE_S
        while self._speed_m_s(int(np.count_nonzero(self._cycles["t_ns"]))) < (
            _NEARLY * FULL_SPEED_M_S
        ):
            if time.monotonic() > deadline_s:
                raise TimeoutError("the arm does not reach its full speed")
            time.sleep(0.002)

    def row(self, scenario: Scenario, fault_ns: int) -> Row:
        """What became of the motion since `fault_ns`."""
        count = int(np.count_nonzero(self._cycles["t_ns"]))
        t_ns = np.array(self._cycles["t_ns"][:count])
        at = int(np.searchsorted(t_ns, fault_ns))
        positions = np.array([self._position(row) for row in range(at - 1, count)])
        moving = np.linalg.norm(positions - positions[-1], axis=1) > REST_M
        rest = at - 1 + int(np.count_nonzero(moving))
        ways = np.linalg.norm(positions - positions[0], axis=1)
        return Row(
            fault=scenario.name,
            repetitions=1,
            speed_mm_s=1000 * self._speed_m_s(at),
            zero_commanded_ms=self._zero_ms(fault_ns),
            at_rest_ms=max(0.0, (t_ns[min(rest, count - 1)] - fault_ns) / 1e6),
            travelled_mm=1000 * float(ways.max()),
            at_most_ms=scenario.at_most_ms,
        )

    def _zero_ms(self, fault_ns: int) -> float:
        """When the last motion that was still commanded ended, by whatever ended it."""
        known = self._events[: int(np.count_nonzero(self._events["t_ns"]))]
        t_ns, kinds = np.array(known["t_ns"]), np.array(known["kind"])
        ends = np.isin(kinds, (Kind.STOP, Kind.HALT)) & (t_ns >= fault_ns)
        last_ns = int(t_ns[ends][0]) if ends.any() else np.iinfo(np.int64).max
        moves = np.flatnonzero((kinds == Kind.MOVE) & (t_ns <= last_ns))
        move = int(moves[-1])
        following = t_ns[move + 1 :]
        until_ns = int(t_ns[move]) + self._deadman_ns
        until_ns = min(until_ns, int(following[0])) if len(following) else until_ns
        return max(0.0, (min(until_ns, last_ns) - fault_ns) / 1e6)

    def _speed_m_s(self, count: int) -> float:
        """Over the last cycles before row `count`."""
        first = count - 1 - _STEADY_CYCLES
        if first < 0:
            return 0.0
        distance = float(np.linalg.norm(self._position(count - 1) - self._position(first)))
        return distance / float(self._cycles["t_ns"][count - 1] - self._cycles["t_ns"][first]) * 1e9

    def _position(self, row: int) -> NDArray[np.float64]:
        position: NDArray[np.float64] = self._model.tcp_matrix(self._cycles["joints"][row])[:3, 3]
        return position


def _send(what: signal.Signals, pid: int | None) -> int:
    """The time just before it was sent [ns]."""
    assert pid is not None
    now_ns = time.monotonic_ns()
    os.kill(pid, what)
    return now_ns


def _worst(rows: list[Row]) -> Row:
    return Row(
        fault=rows[0].fault,
        repetitions=len(rows),
        speed_mm_s=min(row.speed_mm_s for row in rows),
        zero_commanded_ms=max(row.zero_commanded_ms for row in rows),
        at_rest_ms=max(row.at_rest_ms for row in rows),
        travelled_mm=max(row.travelled_mm for row in rows),
        at_most_ms=rows[0].at_most_ms,
    )


def table(rows: list[Row]) -> Table:
    shown = Table(box=None)
    shown.add_column("fault", no_wrap=True)
    for name in ("zero commanded", "allowed", "at rest", "travelled"):
        shown.add_column(name, justify="right")
    shown.add_column("")
    for row in rows:
        shown.add_row(
            row.fault,
            f"{row.zero_commanded_ms:.0f} ms",
            f"{row.at_most_ms:.0f} ms",
            f"{row.at_rest_ms:.0f} ms",
            f"{row.travelled_mm:.1f} mm",
            row.verdict,
        )
    return shown


def write(path: Path, rows: list[Row]) -> None:
    content = {
        "what": "fault at full speed; worst of the repetitions; times from just before the cause",
        "cores": os.cpu_count(),
        "faults": [{**asdict(row), "verdict": row.verdict} for row in rows],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument("--repetitions", type=int, default=REPETITIONS)
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    rows = measure(options.repetitions)
    console = Console()
    console.print(table(rows))
    write(options.json, rows)
    console.print(f"written to {options.json}")


if __name__ == "__main__":
    main()
