"""How well each budget uses an uplink, and what the operator sees through it.

`python -m benchmarks.uplink --trace FILE --budget feedback --strategy tams+ --seconds 60` runs the
real encoders, jitter buffers and decoders over an emulated link in virtual time, while the rig's
arm carries a block to and fro; `--rate-kbps N` in place of a trace. Without either, all cases run
that way for up to 25 s with `feedback`, some of them with each budget and repair. `--model` runs
them packet by packet without encoders, in a few minutes; there a trace is run with three delay
targets.
`--field` runs links as they are in the field, those of docs/BUDGET.md, `--seeds N` each of them N
times, of which the means are shown.
`--json` writes the results.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from rich.progress import track
from rich.table import Table

from benchmarks.uplink.cases import (
    DELAY_TARGETS_MS,
    MODELLED_STRATEGY,
    MODES,
    Case,
    Target,
    cases,
    field_cases,
    rate_case,
    trace_case,
)
from benchmarks.uplink.encoded import Result, Sender, mean_result, run_encoded
from benchmarks.uplink.measures import Measures, run_all
from tams_app.config import Network
from tams_app.errors import TamsError
from tams_app.printing import Console
from tams_app.study.unattended import TrialsProgress

COLUMNS = {
    "utilisation": ("used", 100.0),
    "queue_p50_ms": ("p50", 1.0),
    "queue_p95_ms": ("p95", 1.0),
    "queue_max_ms": ("max", 1.0),
    "standing_p95_ms": ("standing p95", 1.0),
    "loss_fraction": ("lost", 100.0),
    "padding_fraction": ("padding", 100.0),
    "skipped_fraction": ("skipped", 100.0),
    "even_fps": ("fps", 1.0),
    "share": ("share", 100.0),
}
SEEN: dict[str, Callable[[Result], str]] = {
    "latency": lambda told: f"{told['latency_ms']['p95']:.0f}",
    "frozen": lambda told: f"{told['frozen_s']:.1f}",
    "received": lambda told: f"{told['primary_ssim']['received']:.3f}",
    "live": lambda told: f"{told['primary_ssim']['live']:.3f}",
    "worst live": lambda told: f"{told['worst_view_live_ssim']:.3f}",
}
CASE_S = 25.0
COMPARED = (*(Sender(mode) for mode in MODES), Sender("feedback", repair="paper"))
WIDTH = 170


def main() -> None:
    options = _options()
    console = Console()
    console.width = max(console.width, WIDTH)  # also where it is written to a file
    link = Network(
        latency_ms=options.latency_ms,
        jitter_ms=options.jitter_ms,
        loss=options.loss,
        loss_burst=options.loss_burst,
    )
    given = [trace_case(path, options.seconds, link) for path in options.trace]
    given += [rate_case(kbps, options.seconds, link) for kbps in options.rate_kbps]
    known = field_cases() if options.field else cases()
    chosen = given or [one for one in known if not options.case or options.case in one.name]
    longest_s = options.seconds if given or options.field else CASE_S
    if options.model:
        chosen = [replace(one, setting=replace(one.setting, fps=options.fps)) for one in chosen]
        modes = (options.budget,) if options.budget else MODES
        modelled = model(chosen, bool(given), modes, options.seeds, console)
        console.print(table(chosen, modelled))
        written: object = modelled
    else:
        chosen = [
            replace(one, setting=replace(one.setting, seconds=min(one.setting.seconds, longest_s)))
            for one in chosen
            if one.encoders_can
        ]
        runs = [(case, sender) for case in chosen for sender in _senders(options, case)]
        encoded = over_encoders(runs, options.seeds, options.processes, console)
        console.print(table(chosen, {c: {s: one["link"] for s, one in row.items()}
                                     for c, row in encoded.items()}, encoded))  # fmt: skip
        alone = len(runs) == 1
        written = encoded[chosen[0].name][str(runs[0][1])] if alone else encoded
    if options.json:
        options.json.write_text(json.dumps(written, indent=2) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.uplink", description=__doc__)
    parser.add_argument("--model", action="store_true", help="without encoders, packet by packet")
    parser.add_argument("--field", action="store_true", help="links as they are in the field")
    parser.add_argument("--case", help="only cases with this in their names")
    parser.add_argument("--fps", type=int, default=30, help="of --model (default 30)")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each, whose means are shown")
    parser.add_argument("--trace", type=Path, action="append", default=[], metavar="FILE")
    parser.add_argument("--rate-kbps", type=float, action="append", default=[], metavar="N")
    link = parser.add_argument_group("the link of --trace and --rate-kbps")
    link.add_argument("--latency-ms", type=float, default=40.0, help="one way (default 40)")
    link.add_argument("--jitter-ms", type=float, default=8.0, help="± (default 8)")
    link.add_argument("--loss", type=float, default=0.0, help="share of packets (default 0)")
    link.add_argument("--loss-burst", type=float, default=1.0, help="mean length (default 1)")
    link.add_argument("--seconds", type=float, default=60.0, help="(default 60)")
    sends = parser.add_argument_group("what sends")
    sends.add_argument("--budget", choices=MODES)
    sends.add_argument("--strategy", default="tams")
    sends.add_argument("--repair", choices=("paper", "adaptive"))
    sends.add_argument("--delay-target-ms", type=float)
    sends.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if (options.trace or options.rate_kbps) and options.case:
        parser.error("--case chooses from the cases; a trace or a rate is one itself")
    return options


def _senders(options: argparse.Namespace, case: Case) -> list[Sender]:
    """What sends in a case: each budget and repair where they are compared, unless one is named."""
    chosen = [Sender(options.budget or "feedback")]
    if case.compared:
        chosen = [one for one in COMPARED if options.budget in (None, one.budget)]
    if options.repair:
        chosen = [replace(one, repair=options.repair) for one in chosen]
    modelled = case.setting.strategy
    changed = (
        replace(
            one,
            strategy=options.strategy if modelled == MODELLED_STRATEGY else modelled,
            delay_target_ms=options.delay_target_ms,
            seed=options.seed,
        )
        for one in chosen
    )
    return list(dict.fromkeys(changed))


def over_encoders(
    runs: Sequence[tuple[Case, Sender]], seeds: int, processes: int, console: Console
) -> dict[str, dict[str, Result]]:
    """The results by case and sender, means of `seeds` runs."""
    named = {
        f"run-{number}-{turn}": (case, replace(sender, seed=sender.seed + turn))
        for number, (case, sender) in enumerate(runs)
        for turn in range(seeds)
    }
    with tempfile.TemporaryDirectory(prefix="uplink-") as folder:
        console.print("recording the hand")
        with TrialsProgress(console, len(named)) as bar:
            found = run_encoded(named, Path(folder), processes, bar.trial_ended)
    results: dict[str, dict[str, Result]] = {}
    for number, (case, sender) in enumerate(runs):
        alike = [found[f"run-{number}-{turn}"] for turn in range(seeds)]
        results.setdefault(case.name, {})[str(sender)] = mean_result(alike)
    return results


def model(
    chosen: Sequence[Case], delay_targets: bool, modes: Sequence[str], seeds: int, console: Console
) -> dict[str, dict[str, Measures]]:
    """Each case under each budget, the means of `seeds` runs.

    `delay_targets`: `feedback` with each of them.
    """
    results: dict[str, dict[str, Measures]] = {}
    for case in track(chosen, description="cases", console=console, transient=True):
        row = results.setdefault(case.name, {})
        for mode in modes:
            if mode == "feedback" and delay_targets:
                for target_ms in DELAY_TARGETS_MS:
                    row[f"feedback, {target_ms:g} ms"] = run_all(case, mode, seeds, target_ms)
            else:
                row[mode] = run_all(case, mode, seeds)
    return results


def table(
    chosen: Sequence[Case],
    results: dict[str, dict[str, Measures]],
    seen: dict[str, dict[str, Result]] | None = None,
) -> Table:
    """A line for each run; per cent, milliseconds at the bottleneck, targets of `feedback`."""
    columns = {key: told for key, told in COLUMNS.items() if not seen or key != "standing_p95_ms"}
    shown = Table("case", "budget", box=None)
    for title in (*(title for title, _ in columns.values()), *(SEEN if seen else ())):
        shown.add_column(title, justify="right")
    shown.add_column("targets")
    for case in chosen:
        for mode, measures in results[case.name].items():
            cells = [_cell(measures.get(key), factor) for key, (_, factor) in columns.items()]
            if seen:
                cells += [told(seen[case.name][mode]) for told in SEEN.values()]
            ours = mode.startswith("feedback")
            verdicts = [_verdict(t, measures) for t in case.targets] if ours else []
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
    try:
        main()
    except TamsError as error:
        sys.exit(str(error))
