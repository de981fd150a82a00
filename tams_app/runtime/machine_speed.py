"""A quick probe of the machine: what its cores can do, before a session asks anything of them.

By it are chosen the frame rate that a session begins with and the simulated operator. It counts the
processor's time, not the clock's, and takes the best of several rounds: what else runs on the
machine meanwhile hardly changes it. What it cannot see, such as programs that take a core all the
time, the ladder of frame rates finds out (`rate_ladder`).
"""

from __future__ import annotations

import os
import random
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

# Seconds that one round of each work takes on the reference, a slow shared core of 2.5 GHz
# (docs/MEASUREMENTS.md). Interpreted code stands for the application's threads, compressing for
# encoder, decoder and renderer.
INTERPRETED_S = 0.0080
COMPRESSING_S = 0.0109
_ROUNDS = 7
_DATA_BYTES = 300_000

# What a session takes, in reference cores: a part that does not depend on the frames, and one for
# each frame a second of all three views. The line through `benchmarks.threads --fps 5` at 628dd78b
# and `--fps 15` on a quiet machine of speed .97 (.69 and 1.12 cores without the comparison of
# frames, which takes what is left over), and .2 for the eyes of an operator who sees.
SESSION_CORES, CORES_PER_FPS = 0.67, 0.041
USABLE = 0.85  # of the cores: where nothing is left over, the control loop waits for a core
LADDER_FPS = (30.0, 20.0, 15.0, 10.0, 7.5, 5.0)


def rungs(asked_fps: float) -> tuple[float, ...]:
    """`asked_fps` and the rates of the ladder below it, falling."""
    return (asked_fps, *(fps for fps in LADDER_FPS if fps < asked_fps))


@dataclass(frozen=True, slots=True)
class MachineSpeed:
    """The processor power of a machine for a session."""

    cores: float  # that this process may use
    speed: float  # of one core; 1.0 is the reference

    @property
    def capacity(self) -> float:
        """Reference cores."""
        return self.cores * self.speed

    def starting_fps(self, asked_fps: float) -> float:
        """The rung of the ladder below `asked_fps` that a session should fit on."""
        for fps in rungs(asked_fps):
            if SESSION_CORES + CORES_PER_FPS * fps <= USABLE * self.capacity:
                return fps
        return rungs(asked_fps)[-1]


@cache
def this_machine() -> MachineSpeed:
    """Measured once in a process, in about .2 s."""
    interpreted = INTERPRETED_S / _best_s(_interpret)
    data = bytes(random.Random(0).choices(range(16), k=_DATA_BYTES))
    compressing = COMPRESSING_S / _best_s(lambda: zlib.compress(data, 6))
    return MachineSpeed(usable_cores(), (interpreted * compressing) ** 0.5)


def _best_s(work: Callable[[], object]) -> float:
    """The processor's time of the fastest round."""
    rounds = []
    for _ in range(_ROUNDS):
        began_s = time.thread_time()
        work()
        rounds.append(time.thread_time() - began_s)
    return min(rounds)


def usable_cores() -> float:
    """Those that this process may use."""
    if not hasattr(os, "sched_getaffinity"):
        return float(os.cpu_count() or 1)
    return float(len(os.sched_getaffinity(0)))


def _interpret() -> float:
    state = {"x": 0.0, "v": 1.0}
    for _ in range(40_000):
        force = -4.0 * state["x"] - 0.1 * state["v"]
        state["v"] += force * 0.01
        state["x"] += state["v"] * 0.01
    return state["x"]
