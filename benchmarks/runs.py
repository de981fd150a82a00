"""Whole sessions, started as a user starts them, and what their logs say."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tams_app.recording import SessionLog, read_log
from tams_app.runtime.process import PROJECT_DIRECTORY

MOVING_M_S = 0.005


@dataclass(frozen=True, slots=True)
class Run:
    """One finished session; `spawned_wall_ns` is when its command was started."""

    spawned_wall_ns: int
    summary: dict[str, Any]
    log: SessionLog

    @property
    def first_motion_s(self) -> float | None:
        """From the command to the first reported motion of the arm."""
        offset_ns = self.log.header.wall_offset_ns
        for tick in self.log.ticks:
            if tick.speed > MOVING_M_S and tick.deadman:
                return (tick.started_ns + offset_ns - self.spawned_wall_ns) / 1e9
        return None


def run_session(out: Path, *options: str, headless: bool = True) -> Run:
    """`run_tams.py run --sim --headless` with `options`; RuntimeError with its words on failure.

    `headless` False: with the window, on the display of this process's environment.
    By the scripted operator, unless they say otherwise: the machine's speed must not change what
    is done.
    """
    before = set(out.glob("*/"))
    command = [sys.executable, "run_tams.py", "run", "--sim", "--out", str(out)]
    command += ["--headless"] if headless else []
    if "--operator" not in options:
        command += ["--operator", "scripted"]
    spawned_ns = time.time_ns()
    result = subprocess.run(
        [*command, *options],
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    if result.returncode:
        raise RuntimeError(f"{' '.join(options)}: {result.stderr.strip()}")
    (folder,) = set(out.glob("*/")) - before
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return Run(spawned_ns, summary, read_log(folder / "session.mcap"))
