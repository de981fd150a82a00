"""Does the rate on the wire follow the target? An example trial and all trials' errors."""

from __future__ import annotations

from tams_app.recording import read_log
from tams_app.study.figures import bitrates_figure
from tams_app.study.report.blocks import Block, Paragraph, Section, Table
from tams_app.study.report.drawing import picture
from tams_app.study.report.wording import PHASES, interval, name, number
from tams_app.study.results import StudyData, TrialResult, participant_means
from tams_app.study.statistics.intervals import mean_interval
from tams_app.study.tables import value_at

LOG_NAME = "session.mcap"


def tracking_section(data: StudyData) -> Section:
    """The example is the first completed trial of the proposed strategy with all six phases."""
    blocks: list[Block] = []
    example = _example(data)
    if example is None:
        blocks.append(Paragraph("No log of a trial is at hand, so no example can be drawn."))
    else:
        trial = example.trial
        where = f"{name(trial.strategy)} on {name(trial.network)} ({trial.id})"
        blocks.append(
            picture(
                bitrates_figure(read_log(example.folder / LOG_NAME)),
                "tracking",
                f"Target and measured rate of each view, {where}; dashed lines: phases.",
                f"Rates over time of the views {', '.join(data.config.video.views)}: the measured "
                "curve beside the target's steps.",
            )
        )
    blocks += [_errors(data), _delivery(data)]
    return Section("Bitrate tracking and delivery", tuple(blocks))


def _example(data: StudyData) -> TrialResult | None:
    networks = data.plan.networks
    middle = networks[len(networks) // 2]
    candidates = [one for one in data.results if (one.folder / LOG_NAME).is_file()]

    def unfitness(one: TrialResult) -> tuple[bool, bool, bool, int]:
        all_phases = len(one.phases) == len(PHASES)
        return (
            one.strategy != data.plan.proposed,
            one.network != middle,
            not one.completed,
            not all_phases,
        )

    return min(candidates, key=unfitness, default=None)


def _errors(data: StudyData) -> Table:
    rows = []
    for strategy in data.plan.strategies:
        for network in data.plan.networks:
            results = data.of(strategy, network)
            cells = [
                interval(mean_interval(participant_means(results, _error(results, view))), 3)
                for view in data.config.video.views
            ]
            rows.append((f"{name(strategy)}, {name(network)}", *cells))
    header = ("Condition", *(view.upper() for view in data.config.video.views))
    caption = (
        "Tracking error, mean |sent − target| / target over windows of 8 frames, with 95 % "
        "intervals over participants"
    )
    return Table(caption, header, tuple(rows))


_DELIVERY = {
    "Sent [kbit/s]": ("uplink.sent_kbps_mean", 0),
    "Utilisation": ("uplink.utilisation", 2),
    "Queue p95 [ms]": ("uplink.queue_ms.p95", 1),
    "Loss": ("uplink.loss_fraction", 4),
    "Loss after repair": ("uplink.residual_loss_fraction", 4),
}
_DELIVERY_VIEWS = {
    "Latency p50 [ms]": ("latency_ms.p50", 0),
    "Frozen [s]": ("freezes.total_s", 2),
}


def _delivery(data: StudyData) -> Table:
    """What reached the operator, as evidence for what follows."""
    rows = []
    for strategy in data.plan.strategies:
        for network in data.plan.networks:
            results = data.of(strategy, network)
            cells = [
                _mean([value_at(one.summary, path) for one in results], digits)
                for path, digits in _DELIVERY.values()
            ]
            cells += [
                _mean([_view_mean(data, one, path) for one in results], digits)
                for path, digits in _DELIVERY_VIEWS.values()
            ]
            rows.append((f"{name(strategy)}, {name(network)}", *cells))
    header = ("Condition", *_DELIVERY, *_DELIVERY_VIEWS)
    caption = "Delivery, means over trials; latency (capture to screen) and freezes: mean of views"
    return Table(caption, header, tuple(rows))


def _view_mean(data: StudyData, result: TrialResult, path: str) -> float | None:
    views = result.summary.get("views", {})
    values = [value_at(views.get(view) or {}, path) for view in data.config.video.views]
    known = [float(value) for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _mean(values: list[float | None], digits: int) -> str:
    known = [float(value) for value in values if value is not None]
    return number(sum(known) / len(known) if known else None, digits)


def _error(results: list[TrialResult], view: str) -> list[float | None]:
    return [(one.summary.get("views", {}).get(view) or {}).get("tracking_error") for one in results]
