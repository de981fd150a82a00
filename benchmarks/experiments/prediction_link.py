"""How far off the arm is predicted over the real link, against what the robot's side logged.

`python -m benchmarks.experiments.prediction_link` lets a hand go to and fro at up to 250 mm/s and
turn round every .35 to .65 s, in an operator's side with `view.predict: eih` that a relay joins
with a robot's side, .3 % loss. Both have the clock of this computer.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from hw.lite6.figure import Lite6Figure
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import MountPrediction, Tick, Vector
from tams_app.station.mount_memory import MountMemory
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink

WAYS_MS = ((20.0, 5.0), (40.0, 8.0), (100.0, 25.0), (200.0, 30.0))  # delay, at most so much more
_UPLINK_KBPS = 6000.0
_FPS = 10
_MOVED_M = 0.002  # since the newest state: the arm moves
_TURN_S = (0.35, 0.5, 0.65)


def drive(folder: Path, way: Conditions, turns: int) -> list[MountPrediction]:
    """Where the flange was believed to be, while the hand went to and fro."""
    found: list[MountPrediction] = []
    budget: dict[str, Any] = {"budget": {"mode": "feedback", "max_kbps": _UPLINK_KBPS}}
    with (
        patch.object(MountMemory, "put", lambda _, placed: found.append(placed)),
        RobotSide(folder / "robot", video={"fps": _FPS}, policy=budget) as robot,
    ):
        robot.waits()
        with (
            ImpairedLink((HOST, robot.port), way, way) as link,
            HandSide(folder / "operator", link.port, predict="eih") as side,
        ):
            side.moves()
            for turn in range(turns):
                time.sleep(_TURN_S[turn % len(_TURN_S)])
                side.hand.velocity = -side.hand.velocity * (0.6 if turn % 2 else 1 / 0.6)
    return found


def errors_m(placed: list[MountPrediction], ticks: list[Tick]) -> tuple[Vector, Vector, float]:
    """Of the newest state and of the prediction, while the arm moves; the share not trusted."""
    figure = Lite6Figure()
    reports = [tick.arm for tick in ticks if tick.arm is not None]
    times_ns = np.array([arm.received_ns for arm in reports])
    joints = np.array([arm.joints for arm in reports])
    late, predicted = [], []
    for one in placed:
        if times_ns[0] < one.now_ns < times_ns[-1]:
            true = np.array([np.interp(one.now_ns, times_ns, each) for each in joints.T])
            place = figure.place(true)[figure.flange].position
            late.append(np.linalg.norm(one.then.position - place))
            predicted.append(np.linalg.norm(one.now.position - place))
    moves = np.array(late) > _MOVED_M
    doubted = float(np.mean([not one.trusted for one in placed]))
    return np.array(late)[moves], np.array(predicted)[moves], doubted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=30, help="of the hand (default 30)")
    options = parser.parse_args()
    shown = Table("each way", "newest state [mm] p50", "p95", "predicted [mm] p50", "p95",
                  "not trusted", "stops", box=None)  # fmt: skip
    for delay_ms, more_ms in WAYS_MS:
        with tempfile.TemporaryDirectory() as folder:
            way = Conditions(latency_ms=delay_ms, jitter_ms=more_ms, loss=0.003)
            placed = drive(Path(folder), way, options.turns)
            log = read_log(next((Path(folder) / "robot").rglob(LOG_NAME)))
        late_m, predicted_m, doubted = errors_m(placed, log.ticks)
        figures = (*np.percentile(late_m, (50, 95)), *np.percentile(predicted_m, (50, 95)))
        stops = ", ".join(stop.reason for stop in log.stops)
        shown.add_row(f"{delay_ms:g} to {delay_ms + more_ms:g} ms",
                      *(f"{1000 * value:.2f}" for value in figures), f"{doubted:.1%}", stops
                      )  # fmt: skip
    Console().print(shown)


if __name__ == "__main__":
    main()
