"""Agreement of trials in virtual time with live ones: `python -m benchmarks.experiments.agreement`.

For each seed a hand is recorded (`recorded_motion`) and replayed twice with the same scene, noise,
losses and network: in a live session as a user starts one, and in virtual time. Bitrates of each
view must agree within 5 %, its SSIM and that of the primary view within .01, in the mean over the
seeds. The other rows are for finding out why, where they do not.

Live, only as many frames are scored as the machine has time for. Their scores are those of what
was shown, which no decoding afterwards could give; so they are compared with the virtual frames of
the same moments of the hand ("at equal moments"), and the mean over all virtual frames stands
beside it. Needs the machine to itself: about two minutes a seed. A machine that cannot draw 90
frames a second beside a session (`live_runs_kept_up`) takes a smaller `--fps`, for both runs.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.progress import Progress
from rich.table import Table

from benchmarks.experiments.agreement_pairs import Pair, measure_seed
from benchmarks.experiments.agreement_verdicts import (
    RATE_LIMIT,
    SSIM_LIMIT,
    Agreement,
    compare,
    overall,
)
from tams_app.printing import Console
from tams_app.study.runner import machine

RESULTS = Path(__file__).parent / "results" / "agreement.json"
COUNT = "_n"  # ends the measures that count another one's frames


@dataclass(frozen=True, slots=True)
class Setting:
    """What is run: so many seeds under one network and strategy."""

    seeds: int = 5
    network: str = "s2"
    strategy: str = "tams"
    fps: int = 30

    @property
    def command(self) -> str:
        """What measures it again."""
        return (
            f"python -m benchmarks.experiments.agreement --seeds {self.seeds} "
            f"--network {self.network} --strategy {self.strategy} --fps {self.fps}"
        )

    def given(self, seed: int) -> dict[str, Any]:
        """Of the configuration, for one seed."""
        return {
            "seed": seed,
            "network": self.network,
            "strategy": self.strategy,
            "video.fps": self.fps,
            "headless": True,
        }


def measure(setting: Setting, progress: Progress) -> list[Pair]:
    """All seeds, one run after the other."""
    task = progress.add_task("live and virtual runs", total=setting.seeds)
    pairs = []
    for seed in range(setting.seeds):
        with tempfile.TemporaryDirectory(prefix="tams-agreement-") as folder:
            pairs.append(measure_seed(Path(folder), setting.given(seed)))
        progress.update(task, advance=1)
    return pairs


def agreements(pairs: list[Pair]) -> list[Agreement]:
    """Every measure of every view; those with a promise first."""
    rows = [
        _compared(pairs, view, measure)
        for view, measures in pairs[0].live.items()
        for measure in measures
    ]
    return sorted(rows, key=lambda row: row.limit is None)  # stable: the views keep together


def _compared(pairs: list[Pair], view: str, measure: str) -> Agreement:
    values = [(pair.live[view][measure], pair.virtual[view][measure]) for pair in pairs]
    if measure.endswith("_kbps"):
        return compare(view, measure, values, RATE_LIMIT, relative=True)
    promised = measure.endswith("_ssim_at_equal_moments")
    return compare(view, measure, values, SSIM_LIMIT if promised else None)


def table(rows: list[Agreement]) -> Table:
    shown = Table(box=None)
    heads = ("view", "measure", "live", "virtual", "difference", "± seeds", "limit", "frames", "")
    for name in heads:
        left = name in ("view", "measure", "")
        shown.add_column(name, justify="left" if left else "right", no_wrap=True)
    counts = {(row.view, row.measure): row for row in rows}
    for row in rows:
        if row.measure.endswith(COUNT):
            continue
        share = row.measure.endswith("_kbps")
        shown.add_row(
            row.view,
            row.measure.replace("_", " "),
            _figure(row.live),
            _figure(row.virtual),
            _figure(row.difference, share),
            _figure(row.spread, share),
            "" if row.limit is None else _figure(row.limit, share),
            _frames(counts.get((row.view, row.measure + COUNT))),
            row.verdict,
        )
    return shown


def _frames(count: Agreement | None) -> str:
    """How many frames are behind an SSIM, live and virtual: mean over the seeds."""
    if count is None or count.live is None or count.virtual is None:
        return ""
    return f"{count.live:.0f} / {count.virtual:.0f}"


def _figure(value: float | None, share: bool = False) -> str:
    if value is None:
        return "–"
    return f"{value:.2%}" if share else f"{value:.4g}"


def _sentence(pair: Pair) -> str:
    """How alike the motion of one seed was, and whether the machine kept up with the live run."""
    motion, ended = pair.facts["motion"], pair.facts["outcome"]
    phases = "other phases"
    if motion["same_phases"]:
        phases = f"phases within {1000 * motion['largest_phase_shift_s']:.0f} ms"
    told = (
        f"seed {pair.seed}: arms {motion['rms_mm']:.1f} mm apart (rms; {motion['largest_mm']:.1f} "
        f"at most), {phases}; live {ended['live']['reason']}, "
        f"{ended['live']['completion_time_s']} s, virtual {ended['virtual']['reason']}, "
        f"{ended['virtual']['completion_time_s']} s"
    )
    return told if pair.kept_up else f"{told}; THE MACHINE DID NOT KEEP UP WITH THE LIVE RUN"


def write(path: Path, command: str, rows: list[Agreement], pairs: list[Pair]) -> None:
    content = {
        "command": command,
        "machine": {**machine(), "cores": os.cpu_count()},
        "verdict": overall(rows),
        "live_runs_kept_up": all(pair.kept_up for pair in pairs),
        "rows": [{**asdict(row), "verdict": row.verdict} for row in rows],
        "seeds": [asdict(pair) for pair in pairs],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    usual = Setting()
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.experiments.agreement", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=usual.seeds)
    parser.add_argument("--network", default=usual.network)
    parser.add_argument("--strategy", default=usual.strategy)
    parser.add_argument("--fps", type=int, default=usual.fps)
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    setting = Setting(options.seeds, options.network, options.strategy, options.fps)
    console = Console()
    with Progress(console=console) as progress:
        pairs = measure(setting, progress)
    rows = agreements(pairs)
    console.print(table(rows))
    for pair in pairs:
        console.print(_sentence(pair), highlight=False)
    write(options.json, setting.command, rows, pairs)
    console.print(f"live and virtual agree: {overall(rows)}; written to {options.json}")


if __name__ == "__main__":
    main()
