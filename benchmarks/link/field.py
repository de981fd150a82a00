"""Whole tasks over two computers through links as they are in the field.

Both sides run as a user starts them, the operator who sees at one, the rig at the other; between
them a relay impairs both directions alike. Neither side is configured for the link.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.link.sides import application
from benchmarks.trace_models import generate
from tams_app.link.keys import new_key
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.teleop.safety import ArmingState
from tams_app.video.live.traces import CSV_HEADER
from tests.impaired_link import HOST, Conditions, ImpairedLink

FPS = 10
_PORT = 7410
_PATIENCE_S = 90.0
# At 6 Mbit/s. A delay of the relay is between latency_ms and jitter_ms more.
FAR = {
    "100 ± 25 ms": Conditions(latency_ms=75.0, jitter_ms=50.0, even=True, loss=0.001),
    "200 ± 30 ms": Conditions(latency_ms=170.0, jitter_ms=60.0, even=True, loss=0.001),
}


@dataclass(frozen=True, slots=True)
class _Session:
    link: str
    way: Conditions
    seed: int


def fields(folder: Path, times: int, seconds: float, traces: Sequence[Path]) -> dict[str, Any]:
    """`times` sessions over each of three LTE models and of `traces`, twice that over far ones."""
    six = folder / "six.csv"
    six.write_text(f"{CSV_HEADER}\n0,6000\n", encoding="utf-8")
    sessions = [
        _Session(name, replace(way, trace=str(six)), seed)
        for name, way in FAR.items()
        for seed in range(2 * times)
    ]
    lte = {path.stem: path for path in traces}
    for seed in (1, 2, 3):
        lte[f"LTE model {seed}"] = folder / f"lte-{seed}.csv"
        lte[f"LTE model {seed}"].write_text(generate("still", seed, 120.0), encoding="utf-8")
    for name, path in lte.items():
        way = Conditions(latency_ms=32.0, jitter_ms=16.0, even=True, trace=str(path))
        sessions += [_Session(name, way, seed) for seed in range(times)]
    rows = []
    for number, session in enumerate(sessions):
        rows.append(_row(session, folder / str(number), seconds))
        print(json.dumps(rows[-1]), flush=True)
    return {"sessions": rows, "links": {name: _summary(rows, name) for name in (*FAR, *lte)}}


def _summary(rows: list[dict[str, Any]], link: str) -> dict[str, Any]:
    ours = [row for row in rows if row["link"] == link]
    placed = [row["completion_s"] for row in ours if row["completion_s"] is not None]
    return {
        "sessions": len(ours),
        "placed": len(placed),
        "completion_s_median": median(placed) if placed else None,
        "holds_median": median(row["holds"] for row in ours),
        "faults_median": median(row["faults"] for row in ours),
    }


def _row(session: _Session, folder: Path, seconds: float) -> dict[str, Any]:
    summary, log = _session(session, folder, seconds)
    states = [tick.arming for tick in log.ticks]
    begun = Counter(now for before, now in pairwise(states) if now != before)
    return {
        "link": session.link,
        "seed": session.seed,
        "completion_s": summary["outcome"]["completion_time_s"],
        "holds": begun[ArmingState.HOLDING.value],
        "faults": begun[ArmingState.FAULT.value],
        "reasons": dict(Counter(stop["reason"] for stop in summary["arm"]["stops"])),
        "late_fraction": summary["control"]["late_fraction"],
        "latency_p95_ms": max(
            (view["latency_ms"]["p95"] or 0.0 for view in summary["views"].values()), default=None
        ),
    }


def _session(session: _Session, folder: Path, seconds: float) -> tuple[dict[str, Any], SessionLog]:
    """The summary of both sides of one session, and the robot's log."""
    folder.mkdir()
    key = folder / "key"
    new_key(key)
    common = ["--key", str(key), "--seed", str(session.seed), "--fps", str(FPS)]
    robot = ["robot", "--sim", "--listen", f"{HOST}:{_PORT}", "--network", "none"]
    robot += ["--budget", "feedback", "--seconds", str(seconds), "--out", str(folder / "robot")]
    with ExitStack() as stack:
        relay = ImpairedLink((HOST, _PORT), session.way, session.way, session.seed)
        stack.enter_context(relay)
        operate = ["operate", "--sim", "--headless", "--robot", f"{HOST}:{relay.port}"]
        operate += ["--out", str(folder / "operate")]
        beside_arm = stack.enter_context(application(*robot, *common))
        operator = stack.enter_context(application(*operate, *common[:4]))
        for name, process in (("operate", operator), ("robot", beside_arm)):
            words, _ = process.communicate(timeout=seconds + _PATIENCE_S)
            if process.returncode not in (0, 1):
                raise RuntimeError(f"{name}: {words[-500:]}")
    (ours,) = (folder / "robot").glob("*/")
    (theirs,) = (folder / "operate").glob("*/")
    command = [sys.executable, "run_tams.py", "report", str(ours), str(theirs)]
    subprocess.run(command, cwd=PROJECT_DIRECTORY, check=True, capture_output=True)
    summary: dict[str, Any] = json.loads((ours / "summary.json").read_text(encoding="utf-8"))
    return summary, read_log(ours / LOG_NAME)
