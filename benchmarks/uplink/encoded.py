"""A case over the real encoders: a trial in virtual time in which the hand carries to and fro."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.experiments.recorded_motion import record_carrying
from benchmarks.experiments.virtual_runs import read_summary, run_side_by_side
from benchmarks.uplink.cases import Case
from benchmarks.uplink.measures import Measures, measure
from benchmarks.uplink.model import Trace
from tams_app.config import Config, load_config
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import PacketKind
from tams_app.session.virtual.trial import START_NS

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Sender:
    """What sends over a case's link."""

    budget: str
    strategy: str = "tams"
    repair: str = "adaptive"
    delay_target_ms: float | None = None
    seed: int = 1

    def __str__(self) -> str:
        parts = [self.budget]
        parts += [self.strategy] if self.strategy != "tams" else []
        parts += [f"repair {self.repair}"] if self.repair != "adaptive" else []
        parts += [f"{self.delay_target_ms:g} ms"] if self.delay_target_ms is not None else []
        return ", ".join(parts)

    def configure(self, case: Case, hand: Path, rates: Path) -> Config:
        """The trial; `rates` is written with the case's capacity."""
        rates.write_text(case.rates, encoding="utf-8")
        network = case.setting.network.model_copy(update={"trace": str(rates)})
        return load_config(
            None,
            {
                "strategy": self.strategy,
                "network": "case",
                "networks.case": network.model_dump(),
                "policy.budget.mode": self.budget,
                "policy.budget.delay_target_ms": self.delay_target_ms,
                "video.repair.mode": self.repair,
                "seed": self.seed,
                "seconds": case.setting.seconds,
                "trial.limit_s": case.setting.seconds,
                "headless": True,
                "rig.hand_trajectory": str(hand),
                "recording.bitstream": False,
            },
        )


def run_encoded(
    runs: Mapping[str, tuple[Case, Sender]], out: Path, processes: int, ended: Callable[[], None]
) -> dict[str, Result]:
    """The result of each run by its name, which becomes a folder in `out`; TamsError if one fails.

    `ended` is told of each that ends.
    """
    hands: dict[tuple[int, float], Path] = {}
    configs = {}
    for index, (name, (case, sender)) in enumerate(runs.items()):
        key = sender.seed, case.setting.seconds
        if key not in hands:
            hands[key] = out / f"hand-{sender.seed}-{case.setting.seconds:g}.mcap"
            record_carrying(load_config(None, {"seed": sender.seed}), hands[key], key[1])
        configs[name] = sender.configure(case, hands[key], out / f"rates-{index}.csv")
    run_side_by_side(configs, out, processes, ended)
    return {name: _result(case, out / name) for name, (case, _) in runs.items()}


def mean_result(results: Sequence[Result]) -> Result:
    """The mean of each figure; of one that a run has not, None."""

    def mean(values: Sequence[Any]) -> Any:
        if isinstance(values[0], dict):
            return {key: mean([one[key] for one in values]) for key in values[0]}
        return None if None in values else sum(values) / len(values)

    found: Result = mean(results)
    return found


def _result(case: Case, folder: Path) -> Result:
    link = _measure_link(case, folder / LOG_NAME)
    summary = read_summary(folder)
    primary, views, uplink = summary["primary_view"], summary["views"], summary["uplink"]
    return {
        "utilisation": link["utilisation"],
        "queue_ms": {key: link[f"queue_{key}_ms"] for key in ("p50", "p95", "max")},
        "loss_fraction": link["loss_fraction"],
        "residual_loss_fraction": uplink["residual_loss_fraction"],
        "target_kbps_mean": link["target_kbps_mean"],
        "latency_ms": {"p95": max(view["latency_ms"]["p95"] for view in views.values())},
        "primary_ssim": {
            kind: primary[f"{kind}_ssim"] for kind in ("received", "delivered", "live")
        },
        "worst_view_live_ssim": min(view["live_ssim"] for view in views.values()),
        "frozen_s": sum(view["freezes"]["total_s"] or 0.0 for view in views.values()),
        "resent_fraction": uplink["resent_fraction"],
        "parity_fraction": uplink["parity_fraction"],
        "link": link,
    }


def _measure_link(case: Case, log_path: Path) -> Measures:
    """The same measures as the model's, from the log of a trial."""
    log = read_log(log_path)
    packets = sorted(log.packets, key=lambda packet: packet.entered_ns)
    dropped = {(one.view, one.index) for one in log.dropped}
    kept: dict[str, list[int]] = {}
    for frame in log.captured:
        if (frame.view, frame.index) not in dropped:
            kept.setdefault(frame.view, []).append(frame.capture_ns)
    trace = Trace(
        packets=packets,
        kept=kept,
        targets=[(one.t_ns, sum(one.target_kbps.values())) for one in log.allocations],
        padding_bytes=sum(p.size_bytes for p in packets if p.kind is PacketKind.PADDING),
        frames=len(log.captured),
        skipped=len(log.dropped),
    )
    return measure(case, trace, START_NS)
