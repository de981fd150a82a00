"""What a run of the model comes to: use of the link, queue, loss, and how soon it follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from benchmarks.uplink.cases import Case
from benchmarks.uplink.model import Model, Trace, departed_bytes
from tams_app.config import load_config
from tams_app.policy.budget import BUDGETS
from tams_app.records import PacketFate, PacketRecord
from tams_app.units import NS_PER_MS, NS_PER_S

Measures = dict[str, float | None]
_HEARD_NS = 150 * NS_PER_MS  # the least time from an event at the link to a target


def run_all(case: Case, mode: str, seeds: int, delay_target_ms: float | None = None) -> Measures:
    """The means of runs with the seeds from 1 on; of what was never reached, None."""
    runs = [run(case, mode, delay_target_ms, seed) for seed in range(1, seeds + 1)]
    return {key: _mean([one[key] for one in runs]) for key in runs[0]}


def run(case: Case, mode: str, delay_target_ms: float | None = None, seed: int = 1) -> Measures:
    """One run of the model under the budget `mode`."""
    case = replace(case, setting=replace(case.setting, seed=seed))
    policy = load_config(
        None, {"policy.budget.mode": mode, "policy.budget.delay_target_ms": delay_target_ms}
    ).policy
    capacity = case.capacity(Model.START_NS)
    trace = Model(
        case.setting, capacity, lambda: BUDGETS[policy.budget.mode](policy, capacity), policy
    ).run()
    standing = sorted(ns / NS_PER_MS for ns in trace.standing_ns)
    return {**measure(case, trace, Model.START_NS), "standing_p95_ms": _percentile(standing, 0.95)}


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if len(known) == len(values) else None


def measure(case: Case, trace: Trace, start_ns: int) -> Measures:
    """What happened at the link from `start_ns` on: fractions, kbit/s and milliseconds.

    Times count from the case's change of capacity.
    """
    end_ns = start_ns + round(case.setting.seconds * NS_PER_S)
    capacity = case.capacity(start_ns)
    carried = capacity.mean_kbps(start_ns, end_ns) * (end_ns - start_ns) / 8e6  # bytes
    own = departed_bytes(trace.packets, start_ns, end_ns) / carried
    others = departed_bytes(trace.others, start_ns, end_ns) / carried
    waits = sorted(_wait_ms(r) for r in trace.packets if r.departed_ns)
    overflown = sum(r.fate is PacketFate.OVERFLOW for r in trace.packets)
    lost = sum(r.fate is not PacketFate.DELIVERED for r in trace.packets)
    measures: Measures = {
        "utilisation": own + others,
        "own_share": own,
        "queue_p50_ms": _percentile(waits, 0.5),
        "queue_p95_ms": _percentile(waits, 0.95),
        "queue_max_ms": waits[-1],
        "overflow_fraction": overflown / len(trace.packets),
        "loss_fraction": lost / len(trace.packets),
        "padding_fraction": trace.padding_bytes / carried,
        "skipped_fraction": trace.skipped / trace.frames,
        "even_fps": max(map(_even_fps, trace.kept.values()), default=0.0),
        "target_kbps_mean": sum(kbps for _, kbps in trace.targets) / len(trace.targets),
    }
    for span in (case.setting.cubic, case.setting.tcp, case.setting.second):
        if span is not None:
            measures["share"] = _share(trace, start_ns, span)
    if case.change_s is not None:
        change_ns = start_ns + round(case.change_s * NS_PER_S)
        kbps = capacity.rate_kbps(change_ns)
        after = [(t_ns, target) for t_ns, target in trace.targets if t_ns >= change_ns]
        late_ns = change_ns + _HEARD_NS  # before it the targets are of the time before the change
        risen = next((t for t, target in after if t >= late_ns and target >= 0.8 * kbps), None)
        below = next((t for t, target in after if target <= kbps), None)
        measures["start_ms" if case.change_s == 0 else "risen_ms"] = _since(risen, change_ns)
        measures["below_ms"] = _since(below, change_ns)
        measures["drained_ms"] = _since(_drained_ns(trace.packets, change_ns), change_ns)
    return measures


def _share(trace: Trace, start_ns: int, span: tuple[float, float]) -> float:
    """Our part of all that left while another flow was there, but for its first 5 s."""
    from_ns, to_ns = (
        start_ns + round((span[0] + 5) * NS_PER_S),
        start_ns + round(span[1] * NS_PER_S),
    )
    own = departed_bytes(trace.packets, from_ns, to_ns)
    return own / max(own + departed_bytes(trace.others, from_ns, to_ns), 1)


def _even_fps(kept_ns: Sequence[int]) -> float:
    """Frames a second, by the longest gap but for one in twenty."""
    gaps = sorted(after - before for before, after in pairwise(kept_ns))
    return NS_PER_S / gaps[int(len(gaps) * 0.95)] if gaps else 0.0


def _wait_ms(record: PacketRecord) -> float:
    return (record.departed_ns - record.entered_ns) / NS_PER_MS


def _percentile(ordered: Sequence[float], share: float) -> float:
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


def _since(t_ns: int | None, change_ns: int) -> float | None:
    return None if t_ns is None else (t_ns - change_ns) / NS_PER_MS


def _drained_ns(packets: Sequence[PacketRecord], change_ns: int) -> int:
    """When the last packet entered, of those of the next second, that waits 50 ms."""
    end_ns = change_ns + NS_PER_S
    late = (r.entered_ns for r in packets if _wait_ms(r) >= 50)
    return max((t_ns for t_ns in late if change_ns <= t_ns < end_ns), default=change_ns)
