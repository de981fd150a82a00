"""What this checkout costs beside another one: `make bench ARGS="--against DIR"`.

Pairs of the same live session and the same trial in virtual time, one of each checkout in turn;
processor time, not the wall's, and the ratios of the pairs. *Encoding* is the streaming thread that
runs x264, *decoding* the one that runs the decoder, each with the colour conversion, packets and
Python on its way; everything else in the application is *beyond*. Every figure of a session counts
from the first to the last moment at which its control loop was seen. About five minutes a pair on
a slow machine, which should have nothing else to do.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from benchmarks.checkouts import Checkout, Setting, run_session, run_trial
from benchmarks.ratios import Run, Side, doubts, markdown, rows, table, turn
from benchmarks.threads import shares
from tams_app.errors import TamsError
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.study.runner import machine

RESULTS = Path(__file__).parent / "results" / "paired.json"
WIDTH = 125  # of the table at least; a terminal may fold it
_INTERRUPTED = 130


@dataclass(slots=True)
class Comparison:
    """The two checkouts, and what has been measured of them so far."""

    before: Checkout
    after: Checkout
    first: Setting
    pairs: int
    runs: list[Run] = field(default_factory=list)
    profiles: list[dict[str, Any]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def measure(self, path: Path, progress: Progress) -> None:
        """All runs in turn; each is kept at once, and one that fails is told and left out."""
        task = progress.add_task("", total=4 * self.pairs)
        for pair in range(self.pairs):
            for kind, side in product(("session", "virtual trial"), turn(pair)):
                measure = self._session if kind == "session" else self._trial
                name = f"pair {pair + 1} of {self.pairs}, {side.value}: {kind}"
                progress.update(task, description=name)
                try:
                    said = measure(pair, side)
                except (RuntimeError, TamsError) as failure:
                    said = f"failed, {failure}"
                    self.failures.append(f"{name}: {failure}")
                progress.console.print(f"{name}: {said}", highlight=False, soft_wrap=True)
                progress.update(task, advance=1)
                self.write(path)

    def _session(self, pair: int, side: Side) -> str:
        cost = run_session(self._checkout(side), self._setting(pair))
        self.runs.append(Run(pair, side, cost.measures))
        profile = {"seconds": round(cost.profile.seconds, 2), **shares(cost.profile)}
        self.profiles.append({"pair": pair, "side": side.value, **profile})
        return (
            f"{cost.measures['fps_given']:.1f} of {self.first.fps} frames a second, "
            f"{cost.measures['beyond_share']:.0%} of a core beyond encoding and decoding, "
            f"control {cost.measures['control_ms_per_tick']:.2f} ms a tick, "
            f"other programs {cost.measures['others_share']:.0%}"
        )

    def _trial(self, pair: int, side: Side) -> str:
        measures = run_trial(self._checkout(side), self._setting(pair))
        self.runs.append(Run(pair, side, measures))
        return f"{measures['virtual_cpu_s_per_s']:.2f} s a virtual second"

    def _checkout(self, side: Side) -> Checkout:
        return self.before if side is Side.BEFORE else self.after

    def _setting(self, pair: int) -> Setting:
        """A seed of its own for every pair."""
        first = self.first
        return Setting(first.seed + pair, first.fps, first.seconds, first.network)

    def write(self, path: Path) -> None:
        """Everything as JSON, and the table as Markdown beside it."""
        found = rows(self.runs)
        content = {
            "machine": {"cores": os.cpu_count(), **machine()},
            "before": self.before.commit,
            "after": self.after.commit,
            "setting": asdict(self.first),
            "after_config": self.after.settings and self.after.settings.read_text("utf-8"),
            "pairs": self.pairs,
            "rows": [row.as_json() for row in found],
            "doubts": doubts(found, self.pairs),
            "failures": self.failures,
            "runs": [
                {"pair": run.pair, "side": run.side.value, **run.measures} for run in self.runs
            ],
            "profiles": self.profiles,
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        path.with_suffix(".md").write_text(markdown(found), encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """Exit code: 0 with every pair, 1 if a run failed, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paired", description=__doc__)
    parser.add_argument(
        "--against", type=Path, required=True, help="the other checkout's directory"
    )
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--fps", type=int, default=5, help="of each view; both must hold it (5)")
    parser.add_argument("--seed", type=int, default=4, help="of the first pair (default 4)")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each run, at most (30)")
    parser.add_argument(
        "--after-config", type=Path, help="settings for this checkout's runs, over its defaults"
    )
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)
    console = Console()
    setting = Setting(options.seed, options.fps, options.seconds)
    try:
        sides = Checkout.at(options.against), Checkout.at(PROJECT_DIRECTORY, options.after_config)
    except RuntimeError as error:
        console.print(str(error), highlight=False, soft_wrap=True)
        return 2
    comparison = Comparison(*sides, setting, options.pairs)
    interrupted = False
    try:
        with Progress(console=console) as progress:
            comparison.measure(options.json, progress)
    except KeyboardInterrupt:
        interrupted = True
    found = rows(comparison.runs)
    console.print(f"{comparison.before.commit} before, {comparison.after.commit} after")
    Console(width=max(console.width, WIDTH)).print(table(found))
    for sentence in (*doubts(found, options.pairs), *comparison.failures):
        console.print(sentence, highlight=False, soft_wrap=True)
    comparison.write(options.json)
    console.print(f"written to {options.json} and {options.json.with_suffix('.md').name}")
    return _INTERRUPTED if interrupted else int(bool(comparison.failures))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
