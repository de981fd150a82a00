"""Where the time of a trial in virtual time goes: `python -m benchmarks.virtual_trial`.

Processor time, of all threads of the process, on one core; each part without the parts within it.
What another program takes meanwhile does not count, but slows what shares its core and its cache:
so a known piece of work is timed once a virtual second, and the trial's cost told in its units too.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.operator.seeing import SeeingPerception
from hw.sim.world.scene_renderer import CameraImages
from tams_app.config import load_config
from tams_app.printing import Console
from tams_app.recording.journal import DirectRecorder
from tams_app.robot.control import ControlLoop
from tams_app.robot.engine import Engine
from tams_app.robot.observers import TRIAL_RATE_HZ
from tams_app.session.virtual import runner
from tams_app.session.virtual.runner import run_virtual_trial
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.session.virtual.video import FrameScores
from tams_app.study.runner import machine
from tams_app.video.virtual.video import VirtualVideo

RESULTS = Path(__file__).parent / "results"
TARGET = 0.5  # virtual seconds per second of one core
# part -> where it is done
PARTS: dict[str, tuple[tuple[Any, str], ...]] = {
    "start": ((VirtualTrial, "__init__"),),
    "rendering": ((CameraImages, "take"),),
    "encoding": ((VirtualVideo, "push"),),
    "link, jitter buffers, decoding": ((VirtualVideo, "advance_to"),),
    "SSIM": (
        (FrameScores, "captured"),
        (FrameScores, "shown"),
        (FrameScores, "finish"),
    ),
    "the operator's eyes": ((SeeingPerception, "watch"),),
    "arm and physics": ((InProcessArm, "_catch_up"),),
    "hand, control, phase": ((ControlLoop, "tick"),),
    "recording": ((DirectRecorder, "keep"), (DirectRecorder, "close")),
    "reading back, summary": ((runner, "read_log"), (runner, "summarise")),
}
REFERENCE = "11 by 11 Gaussian window over 640 by 480 float32, separable"
_REFERENCE_ROUNDS = 5
_REFERENCE_PART = "reference"
REST = "events, trial rules, policy"


class Reference:
    """What one known piece of work costs while the trial runs, now and then."""

    def __init__(self) -> None:
        self._calls = 0
        self.times_ms: list[float] = []
        self._field = np.random.default_rng(0).random((480, 640), np.float32)
        self._kernel = cv2.getGaussianKernel(11, 1.5, cv2.CV_32F)

    def after(self, look: Callable[..., Any]) -> Callable[..., Any]:
        """`look`, which is called 30 times a second, and each second a sample after it."""

        @functools.wraps(look)
        def looked(*arguments: Any) -> Any:
            self._calls += 1
            if self._calls % round(TRIAL_RATE_HZ) == 0:
                self.sample()
            return look(*arguments)

        return looked

    def sample(self) -> None:
        began = time.process_time()
        for _ in range(_REFERENCE_ROUNDS):
            cv2.sepFilter2D(self._field, cv2.CV_32F, self._kernel, self._kernel)
        self.times_ms.append((time.process_time() - began) * 1e3 / _REFERENCE_ROUNDS)


class PartTimes:
    """Processor seconds by part; a part within another stops the other's watch."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys((*PARTS, REST, _REFERENCE_PART), 0.0)
        self._running = [REST]
        self._since = time.process_time()

    def wrap(self, part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(work)
        def timed(*arguments: Any, **options: Any) -> Any:
            self._switch()
            self._running.append(part)
            try:
                return work(*arguments, **options)
            finally:
                self._switch()
                self._running.pop()

        return timed

    def _switch(self) -> None:
        now = time.process_time()
        self.seconds[self._running[-1]] += now - self._since
        self._since = now

    def finish(self) -> None:
        """The rest up to now."""
        self._switch()


def measure(network: str, seed: int, seconds: float | None) -> dict[str, Any]:
    """One trial in this process."""
    cv2.setNumThreads(1)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # one core, as in a study
    settings = {"network": network, "seed": seed, "seconds": seconds, "recording.bitstream": False}
    config = load_config(None, settings)
    times, reference = PartTimes(), Reference()
    reference.sample = times.wrap(_REFERENCE_PART, reference.sample)  # type: ignore[method-assign]
    Engine.look = reference.after(Engine.look)  # type: ignore[method-assign]
    for part, places in PARTS.items():
        for owner, name in places:
            setattr(owner, name, times.wrap(part, getattr(owner, name)))
    with tempfile.TemporaryDirectory(prefix="tams-virtual-") as folder:
        began = time.perf_counter()
        run_virtual_trial(config, seed, Path(folder), time.time_ns())
        times.finish()
        wall_s = time.perf_counter() - began
        summary = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))
        log_mb = (Path(folder) / "session.mcap").stat().st_size / 1e6
    del times.seconds[_REFERENCE_PART]
    virtual_s, cpu_s = summary["duration_s"], sum(times.seconds.values())
    reference_ms = float(np.median(reference.times_ms))
    return {
        "command": f"python -m benchmarks.virtual_trial --network {network} --seed {seed}",
        "machine": machine(),
        "virtual_s": virtual_s,
        "cpu_s": round(cpu_s, 2),
        "wall_s": round(wall_s, 2),
        "virtual_s_per_cpu_s": round(virtual_s / cpu_s, 3),
        "reference": REFERENCE,
        "reference_ms": {
            "median": round(reference_ms, 3),
            "least": round(min(reference.times_ms), 3),
        },
        "references_per_virtual_s": round(1e3 * cpu_s / virtual_s / reference_ms),
        "log_mb": round(log_mb, 2),
        "cpu_s_per_virtual_s": {
            part: round(used / virtual_s, 4) for part, used in times.seconds.items()
        },
        "outcome": summary["outcome"],
    }


def table(result: dict[str, Any]) -> Table:
    shown = Table(box=None)
    for name in ("part", "CPU s per virtual s", "share"):
        shown.add_column(name, justify="left" if name == "part" else "right")
    parts = result["cpu_s_per_virtual_s"]
    total = sum(parts.values())
    for part, used in sorted(parts.items(), key=lambda entry: -entry[1]):
        shown.add_row(part, f"{used:.3f}", f"{used / total:.1%}")
    shown.add_row("[bold]all[/]", f"{total:.3f}", "")
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.virtual_trial", description=__doc__)
    parser.add_argument("--network", default="s2")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, help="of virtual time, at most")
    parser.add_argument("--json", type=Path, default=RESULTS / "virtual_trial.json")
    options = parser.parse_args()
    console = Console()
    result = measure(options.network, options.seed, options.seconds)
    console.print(table(result))
    console.print(
        f"{result['virtual_s_per_cpu_s']:.2f} virtual seconds per processor second "
        f"(target: {TARGET:g} or more); one virtual second costs as much as "
        f"{result['references_per_virtual_s']} windowings, which took "
        f"{result['reference_ms']['median']:.2f} ms each",
        highlight=False,
    )
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
