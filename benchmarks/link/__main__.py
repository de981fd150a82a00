"""What a session on two computers does to control, and what an outage does to the arm.

`python -m benchmarks.link [CASE ...]` measures, each with the machine's load beside it:

age (as root): over namespaces with tbf and a relay between, the samples' age beyond the way of one
of them, late ticks of the robot's side, and the video's latency beside that of one computer.
cut: the link is cut while the arm moves at its full speed: the time from when the samples' time is
up (`link.lost_after_ms` after the last that counted) until the arm rests by its own reports (below
1 mm/s), its way from the last sample on. Both ways, and each way alone.
burst: everything is kept back for 2 s and let go at once: how far the arm is told to go by it.
field: whole tasks through a relay, 100 ± 25 and 200 ± 30 ms and over LTE (`--trace` adds a file).
soak: two hours of driving to and fro: memory of each process, late ticks by third, whole logs.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.link.ages import ages
from benchmarks.link.field import fields
from benchmarks.link.outages import bursts, cuts, load
from benchmarks.link.soak import soak
from tams_app.errors import SetupError

LONG = ("field", "soak")


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.link", description=__doc__)
    cases: dict[str, Callable[[Path, int], dict[str, Any]]] = {
        "age": lambda folder, _: ages(folder, options.seconds),
        "cut": lambda folder, times: cuts(folder, times, "both ways"),
        "cut-there": lambda folder, times: cuts(folder, times, "samples only"),
        "cut-back": lambda folder, times: cuts(folder, times, "video and state only"),
        "burst": bursts,
        "field": lambda folder, times: fields(folder, times, options.seconds, options.trace),
        "soak": lambda folder, _: soak(folder, options.soak_seconds),
    }
    parser.add_argument("--seconds", type=float, default=60.0, help="of a session (default 60)")
    parser.add_argument("--soak-seconds", type=float, default=7200.0, help="of soak (default 7200)")
    parser.add_argument(
        "cases", nargs="*", choices=[[], *cases], help="default: all but the last two"
    )
    parser.add_argument("--times", type=int, default=20, help="outages of each kind (default 20)")
    parser.add_argument("--trace", type=Path, action="append", default=[], metavar="FILE")
    parser.add_argument("--json", type=Path, help="kept there; cases not measured now stay")
    options = parser.parse_args()
    found: dict[str, Any] = {}
    if options.json and options.json.exists():
        found = json.loads(options.json.read_text(encoding="utf-8"))
    for name in options.cases or [case for case in cases if case not in LONG]:
        with tempfile.TemporaryDirectory(prefix="tams-link-") as folder:
            before = load()
            try:
                found[name] = cases[name](Path(folder), options.times)
            except SetupError as error:
                found[name] = {"skipped": str(error)}
        found[name]["load"] = [before, load()]
        print(f"{name}: {json.dumps({k: v for k, v in found[name].items() if k != 'outages'})}")
        if options.json:
            options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
