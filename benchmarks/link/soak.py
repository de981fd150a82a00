"""A long session on two computers: whether memory grows, the loop slows down, and logs stay whole.

The hand goes to and fro across the workspace and lets go in between, over a relay with the delay,
jitter and loss of s2, with at most 6 Mbit/s of video. Memory is the anonymous memory of each
process, each half minute: what is mapped from files comes and goes with what else runs. Late ticks
are told by third of the session, and by their place among the ticks from one frame to the next.
"""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from tams_app.config import load_config
from tams_app.recording import LOG_NAME
from tams_app.recording.reader import read_log, read_ticks
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink

_SAMPLED_EACH_S = 30.0
_LATE_NS = NS_PER_MS  # as in summary.json
_REST_S = 1.0
_SUMMARY_S = 3600.0  # of hours of log it takes minutes
_FPS = 10
_UPLINK_KBPS = 6000.0  # the relay has room for all that is asked for


def soak(folder: Path, seconds: float) -> dict[str, Any]:
    """Drive for so long; growth is by a line through the memory after the first fifth."""
    conditions = Conditions(latency_ms=40.0, jitter_ms=8.0, loss=0.003)
    memory: dict[str, list[tuple[float, float]]] = {}
    waits: list[str] = []  # why the arm could not be moved for a minute, each time
    began_s = time.monotonic()
    with RobotSide(
        folder / "robot",
        video={"fps": _FPS},
        policy={"budget": {"mode": "feedback", "max_kbps": _UPLINK_KBPS}},
        trial={"limit_s": 1e6},
        rig={"fixed_fps": True},
    ) as robot:
        robot.waits()
        with (
            ImpairedLink((HOST, robot.port), conditions, conditions) as link,
            HandSide(folder / "operator", link.port) as side,
        ):
            processes = {"robot": psutil.Process(robot.process.pid), "operator": psutil.Process()}
            next_s = 0.0
            while (now_s := time.monotonic() - began_s) < seconds:
                try:
                    side.moves()
                except AssertionError as error:
                    waits.append(str(error))
                    print(f"{now_s:.0f} s, a minute without motion: {error}", flush=True)
                side.hand.velocity = np.zeros(3)
                side.hand.trigger = 0.0
                time.sleep(_REST_S)
                if now_s >= next_s:
                    next_s = now_s + _SAMPLED_EACH_S
                    for name, mb in _memory_mb(processes).items():
                        memory.setdefault(name, []).append((now_s, mb))
                    last = ", ".join(f"{name} {rows[-1][1]:.0f}" for name, rows in memory.items())
                    print(f"{now_s:.0f} s, MB: {last}", flush=True)
        robot.process.send_signal(signal.SIGINT)
        robot.ends(within_s=_SUMMARY_S)
    (recorded,) = (folder / "robot").rglob(LOG_NAME)
    rate_hz = load_config().control.rate_hz
    (numbers, late), per_frame = _late(recorded, rate_hz), round(rate_hz / _FPS)
    operator_log = read_log(folder / "operator" / "session" / LOG_NAME)
    return {
        "seconds": seconds,
        "growth_percent_per_h": {name: _growth(rows, seconds) for name, rows in memory.items()},
        "minutes_without_motion": waits,
        "memory_mb": {name: round(rows[-1][1]) for name, rows in memory.items()},
        "late_fraction_by_third": [_share(part) for part in np.array_split(late, 3)],
        "late_fraction_by_tick_of_frame": [
            _share(late[numbers % per_frame == at]) for at in range(per_frame)
        ],
        "logs_complete": operator_log.complete,
        "states_received": len(operator_log.states_received),
        "frames_shown": len(operator_log.shown),
    }


def _memory_mb(processes: dict[str, psutil.Process]) -> dict[str, float]:
    """Of each side's application and helpers, by module."""
    found: dict[str, float] = {}
    for side, process in processes.items():
        found[side] = anonymous_mb(process.pid)
        # the robot's application is a child of this process
        for child in process.children(recursive=side == "robot"):
            words = child.cmdline()
            if ("-m" in words and side == "robot") or "tams_app.link.gateway" in words:
                name = f"{side}: {words[words.index('-m') + 1]}"
                found[name] = found.get(name, 0.0) + anonymous_mb(child.pid)
        found[f"{side}: together"] = sum(mb for name, mb in found.items() if name.startswith(side))
    return found


def anonymous_mb(pid: int) -> float:
    """As the kernel counts it (proc(5), smaps_rollup)."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        if line.startswith("Anonymous:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise ProcessLookupError(f"process {pid} has no memory of its own")


def _growth(rows: list[tuple[float, float]], seconds: float) -> float | None:
    """Percent of an hour, by a line through what came after the first fifth of the time."""
    late = np.array([row for row in rows if row[0] >= seconds / 5])
    if len(late) < 3:
        return None
    slope_mb_s = np.polyfit(late[:, 0], late[:, 1], 1)[0]
    return round(float(slope_mb_s * 3600 / late[0, 1] * 100), 2)


def _late(path: Path, rate_hz: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Each tick's number, skipped ones counted, and whether it began over a millisecond late."""
    times_ns = np.array([(tick.due_ns, tick.started_ns) for tick in read_ticks(path)])
    since_s = (times_ns[:, 0] - times_ns[0, 0]) / NS_PER_S
    late = times_ns[:, 1] - times_ns[:, 0] > _LATE_NS
    return np.rint(since_s * rate_hz).astype(np.int64), late


def _share(late: NDArray[np.bool_]) -> float:
    return round(float(np.mean(late)), 5)
