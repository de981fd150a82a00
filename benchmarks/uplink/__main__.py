"""How well each budget uses an uplink.

`python -m benchmarks.uplink --model` runs all cases without encoders, packet by packet, in a few
minutes, prints the table and with `--json` writes it. `--trace FILE` adds the trace in a file, with
three settings of the delay target.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.uplink.cases import DELAY_TARGETS_MS, MODES, Case, Target, cases, trace_case
from benchmarks.uplink.measures import Measures, run

COLUMNS = {
    "utilisation": ("used", 100.0),
    "queue_p50_ms": ("p50", 1.0),
    "queue_p95_ms": ("p95", 1.0),
    "queue_max_ms": ("max", 1.0),
    "standing_p95_ms": ("standing p95", 1.0),
    "overflow_fraction": ("overflow", 100.0),
    "padding_fraction": ("padding", 100.0),
    "skipped_fraction": ("skipped", 100.0),
}

WIDTH = 160
Results = dict[str, dict[str, Measures]]


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.uplink", description=__doc__)
    parser.add_argument("--model", action="store_true", required=True,
                        help="without encoders, packet by packet")  # fmt: skip
    parser.add_argument("--trace", type=Path, action="append", default=[], metavar="FILE")
    parser.add_argument("--seconds", type=float, default=120.0, help="of a trace (default 120)")
    parser.add_argument("--case", help="only cases with this in their names")
    parser.add_argument("--budget", choices=MODES, action="append", help="default: all")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    given = [trace_case(path, options.seconds) for path in options.trace]
    chosen = [c for c in (*cases(), *given) if not options.case or options.case in c.name]
    console = Console()
    console.width = max(console.width, WIDTH)  # also where it is written to a file
    results = measure(chosen, given, options.budget or MODES, console)
    console.print(table(chosen, results))
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


def measure(
    chosen: list[Case], given: list[Case], modes: tuple[str, ...], console: Console
) -> Results:
    """Each case under each mode; a given trace also at each delay target."""
    results: Results = {}
    for case in track(chosen, description="cases", console=console, transient=True):
        row = results.setdefault(case.name, {})
        for mode in modes:
            if mode == "feedback" and case in given:
                for target_ms in DELAY_TARGETS_MS:
                    row[f"feedback, {target_ms:g} ms"] = run(case, mode, target_ms)
            else:
                row[mode] = run(case, mode)
    return results


def table(chosen: list[Case], results: Results) -> Table:
    """A line for each run; per cent, milliseconds at the bottleneck, targets of `feedback`."""
    shown = Table("case", "budget", box=None)
    for title, _ in COLUMNS.values():
        shown.add_column(title, justify="right")
    shown.add_column("targets")
    for case in chosen:
        for mode, measures in results[case.name].items():
            cells = [_cell(measures[key], factor) for key, (_, factor) in COLUMNS.items()]
            verdicts = [_verdict(t, measures) for t in case.targets] if mode == "feedback" else []
            shown.add_row(case.name if mode == next(iter(results[case.name])) else "", mode,
                          *cells, "\n".join(verdicts))  # fmt: skip
    return shown


def _cell(value: float | None, factor: float) -> str:
    return "–" if value is None else f"{value * factor:.1f}"


def _verdict(target: Target, measures: Measures) -> str:
    value = measures.get(target.measure)
    met = value is not None and target.met(value)
    return f"{target}: {'never' if value is None else f'{value:.3g}'} {'met' if met else 'MISSED'}"


if __name__ == "__main__":
    main()
