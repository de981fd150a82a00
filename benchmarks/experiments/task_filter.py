"""Whether it helps on a narrow link to blur what is not the task before it is encoded.

`python -m benchmarks.experiments.task_filter` runs scene and participant of each seed with `tams+`
as it is, and with the fixed views blurred outside the task's region, the more so the less their
target is below 400 kbit/s, over links of 300, 500 and 800 kbit/s with the delay, jitter and loss of
s2. In virtual time, with the real encoders and the operator who sees. Scores compare with what was
captured, unblurred. `--json FILE` keeps each pair; pairs that it has already are not run again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.experiments.operator_pairs import OPERATOR_MEASURES, Pairs, operator_measures
from benchmarks.experiments.task_filter_trials import FILTERED, FilteredRuns
from benchmarks.experiments.virtual_runs import read_summary
from tams_app.config import Config, load_config
from tams_app.recording import LOG_NAME, read_log

RATES_KBPS = (300.0, 500.0, 800.0)
NETWORKS = [f"{rate:g}" for rate in RATES_KBPS]
VARIANTS = ("tams+", FILTERED)
SCORES = {
    "task_received_ssim": "task received",
    "task_live_ssim": "task live",
    "received_ssim": "whole received",
}
VIEWS = ("eih", "gt", "gs")
WORDS = {
    **OPERATOR_MEASURES,
    **{f"primary_{key}": f"primary view, {words}" for key, words in SCORES.items()},
    **{f"{view}_{key}": f"{view}, {words}" for view in VIEWS for key, words in SCORES.items()},
}


def config_of(network: str, _variant: str, seed: int) -> Config:
    like = load_config().networks["s2"].model_copy(update={"rate_kbps": float(network)})
    return load_config(
        None,
        {
            "network": "narrow",
            "networks.narrow": like.model_dump(),
            "strategy": "tams+",
            "seed": seed,
            "recording.bitstream": False,
        },
    )


def measures(folder: Path) -> dict[str, Any]:
    """Of one trial; what it has not is None."""
    summary = read_summary(folder)
    scored = {"primary": summary["primary_view"], **summary["views"]}
    return {
        **operator_measures(folder, read_log(folder / LOG_NAME)),
        **{f"{name}_{kind}": one[kind] for name, one in scored.items() for kind in SCORES},
    }


def main() -> None:
    Pairs(NETWORKS, VARIANTS, config_of, measures, WORDS, FilteredRuns).main(__doc__, Console())


if __name__ == "__main__":
    main()
