"""Late ticks and processor time of sessions with one face, beside headless ones.

`python -m benchmarks.faces [--rounds N] [--faces FACE ...] [OPTION ...]`: in each round a headless
session and one with each face, in an order that turns; prints each session, and the median of the
differences within a round. The window is on a virtual screen without a graphics processor; for
Foxglove a process of its own subscribes to every channel; in ROS 2 there is no subscriber. Further
options are those of `run`.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.runs import run_session
from tams_app.runtime.process import PROJECT_DIRECTORY
from tests.faces.window.xvfb import virtual_screen

HEADLESS = "headless"
FACES = {HEADLESS: (), "window": (), "foxglove": ("--foxglove",), "ros2": ("--ros2",)}
FOXGLOVE_URL, FOXGLOVE_PROTOCOL = "ws://127.0.0.1:8765", "foxglove.sdk.v1"
_WATCH = "--watch"


@dataclass(frozen=True, slots=True)
class Cost:
    """What one session took."""

    late_percent: float  # of the ticks
    application_percent: float  # of one core
    given_fps: float  # the view that was given fewest

    def minus(self, other: Cost) -> Cost:
        """By how much it is more than another."""
        return Cost(
            self.late_percent - other.late_percent,
            self.application_percent - other.application_percent,
            self.given_fps - other.given_fps,
        )


def measure(face: str, options: list[str]) -> Cost:
    """One session with that face."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        logs = folder / "logs"
        logs.mkdir()
        screen = virtual_screen(folder, patch) if face == "window" else nullcontext()
        with screen, viewer() if face == "foxglove" else nullcontext():
            run = run_session(logs, *FACES[face], *options, headless=face != "window")
    summary = run.summary
    return Cost(
        100 * summary["control"]["late_fraction"],
        summary["system"]["cpu_percent"]["app"],
        min(view["fps"]["given"] for view in summary["views"].values()),
    )


@contextmanager
def viewer() -> Iterator[None]:
    """A process that subscribes to every channel, as soon as there is a session."""
    command = [sys.executable, "-m", "benchmarks.faces", _WATCH]
    watching = subprocess.Popen(command, cwd=PROJECT_DIRECTORY)
    try:
        yield
    finally:
        watching.terminate()
        watching.wait(10)


def watch() -> None:
    """Receive all that the session offers to Foxglove, until it ends."""
    while True:
        with (
            suppress(OSError, ConnectionClosed),
            connect(FOXGLOVE_URL, subprotocols=[FOXGLOVE_PROTOCOL], max_size=None) as session,
        ):
            for message in session:
                if isinstance(message, str) and "channels" in (told := json.loads(message)):
                    wanted = [{"id": one["id"], "channelId": one["id"]} for one in told["channels"]]
                    session.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        time.sleep(0.2)


def compare(faces: list[str], rounds: int, options: list[str]) -> None:
    """All faces in each round; prints each session and the differences."""
    names = [HEADLESS, *faces]
    costs: dict[str, list[Cost]] = {name: [] for name in names}
    for number in range(rounds):
        turned = names[number % len(names) :] + names[: number % len(names)]
        for name in turned:
            cost = measure(name, options)
            costs[name].append(cost)
            print(
                f"round {number + 1}, {name}: {cost.late_percent:.2f} % of the ticks late, "
                f"application {cost.application_percent:.0f} % of a core, "
                f"{cost.given_fps:.1f} frames a second",
                flush=True,
            )
    for name in faces:
        more = [one.minus(other) for one, other in zip(costs[name], costs[HEADLESS], strict=True)]
        print(
            f"{name} minus headless, median of {rounds}: "
            f"{statistics.median(one.late_percent for one in more):+.2f} % of the ticks late, "
            f"application {statistics.median(one.application_percent for one in more):+.1f} % of "
            f"a core, {statistics.median(one.given_fps for one in more):+.1f} frames a second"
        )


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    others = [name for name in FACES if name != HEADLESS]
    parser.add_argument("--faces", nargs="+", choices=others, default=others)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(_WATCH, action="store_true", help="be the viewer that subscribes")
    arguments, options = parser.parse_known_args()
    if arguments.watch:
        watch()
    else:
        compare(arguments.faces, arguments.rounds, options)


if __name__ == "__main__":
    main()
