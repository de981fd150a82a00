"""How old samples and frames are between two network namespaces, and beside one computer.

The robot's side and the simulated operator's side run as a user starts them, in a namespace each.
Between them: tbf on the robot's side, and a relay for latency, jitter and loss of condition s2. For
comparison the same operator works in one session whose network is emulated to the same condition.
On one machine both sides have the same monotonic clock, so that ages need no estimate.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.link.sides import application
from benchmarks.runs import run_session
from benchmarks.uplink.tbf import namespaces
from benchmarks.uplink.tbf_ends import SENDER_HOST
from tams_app.config import DEFAULT_CONFIG, load_config
from tams_app.link.keys import new_key
from tams_app.recording import SessionLog, read_log
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.units import NS_PER_MS
from tests.impaired_link import Conditions, ImpairedLink

NETWORK = "s2"
FPS = 10
AGE_TARGET_MS = {"p50": 5.0, "p99": 15.0}
LATE_TARGET, LATENCY_TARGET_MS = 0.005, 15.0
_PORT = 7400
_PATIENCE_S = 90.0


def ages(folder: Path, seconds: float) -> dict[str, Any]:
    """One session of each kind; SetupError says what this machine lacks for it."""
    network = load_config().networks[NETWORK]
    latency_ms = network.latency_ms
    assert network.rate_kbps is not None
    with namespaces(network.rate_kbps) as (here, there):
        robot, operator, summary = _two_sides(folder, here, there, seconds)
    reference, late_of_one = _one_computer(folder, seconds)
    counted = [one for one in robot.hands_received if not one.refusal and one.echo_ns]
    refused = Counter(one.refusal for one in robot.hands_received if one.refusal)
    first_ns = counted[0].t_ns
    later = Counter(
        one.refusal for one in robot.hands_received if one.refusal and one.t_ns > first_ns
    )
    sent_ms = [(one.t_ns - one.sent_ns) / NS_PER_MS - latency_ms for one in counted]
    pose_ms = [(one.t_ns - one.pose_ns) / NS_PER_MS - latency_ms for one in counted if one.pose_ns]
    two_ms, one_ms = _latency_ms(robot, operator), _latency_ms(reference, reference)
    return {
        "network": NETWORK,
        "one_way_ms": latency_ms,
        "jitter_ms": network.jitter_ms,
        "sample_age_beyond_one_way_ms": _percentiles(sent_ms),
        "pose_age_beyond_one_way_ms": _percentiles(pose_ms),
        "age_at_use_beyond_one_way_ms": _percentiles(_at_use_ms(robot, latency_ms)),
        "samples": len(counted),
        "samples_refused": dict(refused),
        "samples_refused_later": dict(later),  # than the first that counted
        "late_fraction": summary["control"]["late_fraction"],
        "late_fraction_of_one_computer": late_of_one,
        "stops": [stop["reason"] for stop in summary["arm"]["stops"]],
        "completion_time_s": summary["outcome"]["completion_time_s"],
        "latency_ms": {"two computers": two_ms, "one computer": one_ms},
        "worst_p95_difference_ms": _worst_p95(two_ms) - _worst_p95(one_ms),
    }


def _two_sides(
    folder: Path, here: str, there: str, seconds: float
) -> tuple[SessionLog, SessionLog, dict[str, Any]]:
    """Logs of the robot's side and of the operator's, and the summary of the former."""
    network = load_config().networks[NETWORK]
    key, settings = folder / "key", folder / "session.yaml"
    new_key(key)
    told = {"latency_ms": network.latency_ms, "jitter_ms": network.jitter_ms}
    content = {"version": 1, "include": [str(DEFAULT_CONFIG)], "link": told, "video": {"fps": FPS}}
    settings.write_text(yaml.safe_dump(content), encoding="utf-8")
    common = ["--key", str(key), "--config", str(settings), "--seed", "0"]
    robot = [
        *("robot", "--sim", "--listen", f"{SENDER_HOST}:{_PORT}", "--network", "none"),
        *("--budget", "feedback", "--seconds", str(seconds), "--out", str(folder / "robot")),
    ]
    way = Conditions(network.latency_ms, network.jitter_ms, network.loss)
    relay = ImpairedLink((SENDER_HOST, _PORT), way, way)
    with ExitStack() as stack:
        beside_arm = stack.enter_context(application(*robot, *common, space=here))
        port = stack.enter_context(_relay(there, relay))
        operate = ["operate", "--sim", "--headless", "--robot", f"127.0.0.1:{port}"]
        operate += ["--out", str(folder / "operate")]
        operator = stack.enter_context(application(*operate, *common, space=there))
        for name, process in (("robot", beside_arm), ("operate", operator)):
            words, _ = process.communicate(timeout=seconds + _PATIENCE_S)
            if process.returncode:
                raise RuntimeError(f"{name}: {words[-500:]}")
    (robot_folder,), (operator_folder,) = (folder.glob(f"{one}/*/") for one in ("robot", "operate"))
    summary = json.loads((robot_folder / "summary.json").read_text(encoding="utf-8"))
    return _log(robot_folder), _log(operator_folder), summary


def _one_computer(folder: Path, seconds: float) -> tuple[SessionLog, float]:
    words = ["--network", NETWORK, "--operator", "seeing", "--budget", "feedback", "--seed", "0"]
    words += ["--seconds", str(seconds), "--fps", str(FPS)]
    run = run_session(folder / "one", *words)
    return run.log, run.summary["control"]["late_fraction"]


@contextmanager
def _relay(space: str, relay: ImpairedLink) -> Iterator[int]:
    command = ["ip", "netns", "exec", space, sys.executable, "-m", "tests.impaired_link"]
    command.append(json.dumps(relay.specification()))
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=PROJECT_DIRECTORY, stdin=pipe, stdout=pipe) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        yield int(json.loads(process.stdout.readline())["port"])
        process.stdin.close()  # then it ends by itself


def _at_use_ms(log: SessionLog, latency_ms: float) -> list[float]:
    """At each tick while the operator is there, the age of the newest sample that counted."""
    counted = [(one.t_ns, one.sent_ns) for one in log.hands_received if not one.refusal]
    heard_ns, sent_ns = np.array(counted).T
    started_ns = np.array([tick.started_ns for tick in log.ticks])
    started_ns = started_ns[(started_ns > heard_ns[0]) & (started_ns < heard_ns[-1])]
    newest = np.searchsorted(heard_ns, started_ns) - 1
    ages_ms: list[float] = ((started_ns - sent_ns[newest]) / NS_PER_MS - latency_ms).tolist()
    return ages_ms


def _latency_ms(sender: SessionLog, receiver: SessionLog) -> dict[str, dict[str, float]]:
    """By view, from capture until shown; frames are known by index or RTP timestamp."""
    two = sender is not receiver
    captured = {
        (one.view, one.rtp_timestamp if two else one.index): one.capture_ns for one in sender.sent
    }
    found: dict[str, list[float]] = {}
    for shown in receiver.shown:
        capture_ns = captured.get((shown.view, shown.index))
        if capture_ns is not None:
            found.setdefault(shown.view, []).append((shown.shown_ns - capture_ns) / NS_PER_MS)
    return {view: _percentiles(found[view]) for view in sorted(found)}


def _worst_p95(latency_ms: dict[str, dict[str, float]]) -> float:
    return max(view["p95"] for view in latency_ms.values())


def _percentiles(values: list[float]) -> dict[str, float]:
    p50, p95, p99, most = np.percentile(values, (50, 95, 99, 100))
    return {"p50": float(p50), "p95": float(p95), "p99": float(p99), "max": float(most)}


def _log(folder: Path) -> SessionLog:
    return read_log(folder / "session.mcap")
