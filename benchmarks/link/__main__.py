"""What an outage of the link between two computers does to the arm.

`python -m benchmarks.link [CASE ...]` measures, each with the machine's load beside it:

cut: the link is cut while the arm moves at its full speed: the time from when the samples' time is
up (`link.lost_after_ms` after the last that counted) until the arm rests by its own reports (below
1 mm/s), its way from the last sample on. Both ways, and each way alone.
burst: everything is kept back for 2 s and let go at once: how far the arm is told to go by it.

The robot's side is `run_tams.py robot --sim` as a process; the operator's side is a whole session
whose hand goes at full speed; between them a relay of 20 ms each way with 5 ms of jitter.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tams_app.config import load_config
from tams_app.recording import SessionLog
from tams_app.units import NS_PER_MS
from tests.faults.link_log import Outage, commanded_mm, outage, travelled_mm
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink, Passage

LATENCY_MS, JITTER_MS = 20.0, 5.0
CUT_S, HELD_S, AFTER_S = 1.5, 2.0, 0.5  # samples without a new echo count for a second
REST_TARGET_MS = 100.0
_WAYS: dict[str, tuple[Passage, Passage]] = {
    "both ways": ("cut", "cut"),
    "samples only": ("cut", "open"),
    "video and state only": ("open", "cut"),
}


def cuts(folder: Path, times: int, ways: str) -> dict[str, Any]:
    """Cut the link `times` times; from the end of the samples' time until the arm rests."""
    log, cut_ns = _outages(folder, times, _WAYS[ways], CUT_S)
    lost_after_ms = load_config().link.lost_after_ms
    found = [outage(log, start_ns) for start_ns, _ in cut_ns]
    after_ms = [one.rest_after_ms(lost_after_ms) for one in found]
    from_cut_ms = [
        (one.rest_ns - start_ns) / NS_PER_MS
        for one, (start_ns, _) in zip(found, cut_ns, strict=True)
    ]
    return {
        "ways": ways,
        "times": times,
        "rest_after_limit_ms": _spread(after_ms),
        "within_target": sum(one <= REST_TARGET_MS for one in after_ms),
        "rest_after_cut_ms": _spread(from_cut_ms),
        "stop_after_limit_ms": _spread([_stop_ms(one, lost_after_ms) for one in found]),
        "travel_after_last_sample_mm": _spread([one.travel_mm for one in found]),
        "speed_before_mm_s": _spread([one.speed_mm_s for one in found]),
        "reasons": sorted({one.reason for one in found}),
        "outages": [asdict(one) for one in found],
    }


def bursts(folder: Path, times: int) -> dict[str, Any]:
    """Keep everything back for 2 s, `times` times, and let it go at once."""
    log, held_ns = _outages(folder, times, ("hold", "hold"), HELD_S)
    commanded, travelled, refused, counted = [], [], [], []
    for start_ns, end_ns in held_ns:
        found = outage(log, start_ns)
        assert found.zero_ns < end_ns, "the arm was not stopped when the burst came"
        commanded.append(commanded_mm(log, end_ns)[0])
        travelled.append(travelled_mm(log, end_ns))
        burst = [
            one
            for one in log.hands_received
            if end_ns <= one.t_ns and start_ns < one.sent_ns < end_ns - 10 * NS_PER_MS
        ]
        refused.append(sum(one.refusal != "" for one in burst))
        counted.append(sum(one.refusal == "" for one in burst))
    return {
        "times": times,
        "commanded_mm": _spread(commanded),
        "travelled_mm": _spread(travelled),
        "without_motion": sum(mm == 0.0 for mm in commanded),
        "samples_refused": _spread(refused),
        "samples_counted": _spread(counted),
    }


def _outages(
    folder: Path, times: int, passage: tuple[Passage, Passage], seconds: float
) -> tuple[SessionLog, list[tuple[int, int]]]:
    """The log of a session with so many outages, and from when until when each lasted [ns]."""
    conditions = Conditions(latency_ms=LATENCY_MS, jitter_ms=JITTER_MS)
    lasted = []
    with RobotSide(folder / "robot") as robot:
        robot.waits()
        with (
            ImpairedLink((HOST, robot.port), conditions, conditions) as link,
            HandSide(folder / "operator", link.port) as side,
        ):
            for _ in range(times):
                side.moves()
                start_ns = link.passage(*passage)
                time.sleep(seconds)
                lasted.append((start_ns, link.passage("open", "open")))
                time.sleep(AFTER_S)  # the trigger is pressed and the hand moves on
            side.engages()
        return robot.interrupted(), lasted


def _stop_ms(one: Outage, lost_after_ms: float) -> float:
    return (one.stop_ns - one.sample_ns) / NS_PER_MS - lost_after_ms


def _spread(values: list[float] | list[int]) -> dict[str, float]:
    least, median, most = np.percentile(values, (0, 50, 100))
    return {"min": float(least), "median": float(median), "max": float(most)}


def load() -> float:
    """Processes that ran or waited for a core, over the last minute."""
    return round(os.getloadavg()[0], 2)


CASES: dict[str, Callable[[Path, int], dict[str, Any]]] = {
    "cut": lambda folder, times: cuts(folder, times, "both ways"),
    "cut-there": lambda folder, times: cuts(folder, times, "samples only"),
    "cut-back": lambda folder, times: cuts(folder, times, "video and state only"),
    "burst": bursts,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.link", description=__doc__)
    parser.add_argument("cases", nargs="*", choices=[[], *CASES], help="default: all")
    parser.add_argument("--times", type=int, default=20, help="outages of each kind (default 20)")
    parser.add_argument("--json", type=Path, help="kept there; cases not measured now stay")
    options = parser.parse_args()
    found: dict[str, Any] = {}
    if options.json and options.json.exists():
        found = json.loads(options.json.read_text(encoding="utf-8"))
    for name in options.cases or CASES:
        with tempfile.TemporaryDirectory(prefix="tams-link-") as folder:
            before = load()
            found[name] = CASES[name](Path(folder), options.times)
        found[name]["load"] = [before, load()]
        print(f"{name}: {json.dumps({k: v for k, v in found[name].items() if k != 'outages'})}")
        if options.json:
            options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
