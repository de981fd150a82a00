"""What an outage of the link between two computers does to the arm.

`python -m benchmarks.link [CASE ...]` measures, each with the machine's load beside it:

cut: the link is cut while the arm moves at its full speed: the time from when the samples' time is
up (`link.lost_after_ms` after the last that counted) until the arm rests by its own reports (below
1 mm/s), its way from the last sample on. Both ways, and each way alone.
burst: everything is kept back for 2 s and let go at once: how far the arm is told to go by it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.link.outages import bursts, cuts, load

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
