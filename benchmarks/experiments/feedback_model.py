"""How well the feedback model of virtual time agrees with GStreamer's rtpsession.

`python -m benchmarks.experiments.feedback_model` runs both in virtual time over the same link with
the same seeds, three views each, and prints what repair asked for, got and cost. Each run is a
process of its own. `--networks` measures some networks anew and leaves the results of the others;
`--arrivals` lets receivers tell when each packet came, too.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.experiments.arrivals import Arrivals, NotingLink
from benchmarks.experiments.moving_frames import image
from benchmarks.experiments.rtpsession_views import RtpSessionView
from tams_app import gst
from tams_app.config import Config, Network, load_config
from tams_app.records import EncodedFrame, Frame, PacketKind, PacketRecord, ShownFrame
from tams_app.units import NS_PER_S
from tams_app.video.core.packets import media_ssrc
from tams_app.video.core.received_feedback import ReceivedFeedback
from tams_app.video.core.repair import RepairRule, repair_rule
from tams_app.video.live.networks import network_capacity
from tams_app.video.live.view_decoder import ViewDecoder
from tams_app.video.virtual.event_queue import EventQueue
from tams_app.video.virtual.rtcp_sessions import Feedback
from tams_app.video.virtual.shared import ProcessingTimes, VideoRecords
from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.video import VirtualVideo
from tams_app.video.virtual.wait_idle import IdleWaiter

NETWORKS = ("s1", "s2", "s3")
START_NS = NS_PER_S
AFTER_NS = NS_PER_S  # the last packets and their repair
RESULTS = Path(__file__).parent / "results" / "feedback_model.json"
ROWS = (
    "first_arrivals_us",
    "packets_lost",
    "nacks_sent",
    "nacks_arrived",
    "repairs_sent",
    "repair_bytes",
    "lost_after_repair",
    "plis_sent",
    "plis_arrived",
    "keyframes_forced",
    "frames_shown",
    "receiver_reports_bytes",
    "packets_reported",
    "told_of_as_lost",
    "told_after_us",  # after sending; the mean of each run
)


def main() -> None:
    parser = argparse.ArgumentParser(prog="feedback_model", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=int, default=15)
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=NETWORKS)
    parser.add_argument("--rtx", action="store_true", help="repair by RTX on every network")
    parser.add_argument("--arrivals", action="store_true", help="feedback on each packet")
    parser.add_argument("--json", type=Path, default=RESULTS)
    parser.add_argument("--one", nargs=3, metavar=("KIND", "NETWORK", "SEED"))
    options = parser.parse_args()
    if options.one:
        kind, network, seed = options.one
        print(json.dumps(run(kind, network, int(seed), options)))
        return
    results = measure(options)
    setting = {"seeds": options.seeds, "seconds": options.seconds, "rtx_everywhere": options.rtx}
    setting["arrivals"] = options.arrivals
    content = json.loads(options.json.read_text("utf-8")) if options.json.exists() else {}
    console = Console()
    for network in options.networks:
        console.print(table(network, results[network], options))
        content[network] = {**setting, **results[network]}
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def measure(
    options: argparse.Namespace,
) -> dict[str, dict[str, dict[str, int]]]:
    """Sums over all seeds by network, then by kind of run."""
    results: dict[str, dict[str, dict[str, int]]] = {name: {} for name in options.networks}
    jobs = [
        (name, kind, seed)
        for name in options.networks
        for kind in ("model", "rtpsession")
        for seed in range(1, options.seeds + 1)
    ]
    for name, kind, seed in track(jobs, description="virtual runs"):
        command = [sys.executable, "-m", "benchmarks.experiments.feedback_model"]
        command += ["--one", kind, name, str(seed), "--seconds", str(options.seconds)]
        command += ["--rtx"] if options.rtx else []
        command += ["--arrivals"] if options.arrivals else []
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=900)
        total = Counter(results[name].get(kind, {}))
        total.update(json.loads(done.stdout))
        results[name][kind] = {row: total[row] for row in ROWS}
    return results


def table(name: str, both: dict[str, dict[str, int]], options: argparse.Namespace) -> Table:
    title = f"{name}: three views, {options.seeds} seeds of {options.seconds} s"
    shown = Table("", "model", "rtpsession", title=title, box=None)
    for row in ROWS:
        shown.add_row(row, str(both["model"][row]), str(both["rtpsession"][row]))
    return shown


def run(kind: str, name: str, seed: int, options: argparse.Namespace) -> dict[str, int]:
    """One run of the `model` or of `rtpsession`: the counts of all views together."""
    config = load_config()
    network = config.networks[name]
    rule = repair_rule(network, config.video.pli_min_interval_ms)
    if options.rtx and not rule.rtx:
        patience_ms = round(2.4 * network.latency_ms + 2 * network.jitter_ms + 20)
        rule = RepairRule(True, patience_ms, rule.pli_interval_ms)
    runs = {"model": run_model, "rtpsession": run_rtpsession}
    received = {}
    if options.arrivals:
        received = {
            view: NotingFeedback(view, media_ssrc(config.video, view))
            for view in config.video.views
        }
    counts = runs[kind](config, network, rule, seed, options.seconds, received)
    for one in received.values():
        counts.update(one.counts)
    if received:
        counts["told_after_us"] //= counts["packets_reported"]
    return dict(counts)


class NotingFeedback(ReceivedFeedback):
    """Counts what is told at once."""

    def __init__(self, view: str, ssrc: int) -> None:
        super().__init__(view, ssrc)
        self.counts: Counter[str] = Counter()

    def report(
        self, now_ns: int, packets: Iterable[tuple[int, int, int]], arrived_ns: Mapping[int, int]
    ) -> None:
        super().report(now_ns, packets, arrived_ns)
        for arrival in self.take_arrivals():
            self.counts.update(
                packets_reported=1,
                told_of_as_lost=arrival.arrived_ns is None,
                told_after_us=(now_ns - arrival.sent_ns) // 1000,
            )


def run_model(
    config: Config,
    network: Network,
    rule: RepairRule,
    seed: int,
    seconds: int,
    received: Mapping[str, NotingFeedback],
) -> Counter[str]:
    """The feedback model, as a trial in virtual time uses it."""
    counts: Counter[str] = Counter()
    arrivals = Arrivals(START_NS)

    def note(records: list[PacketRecord]) -> None:
        for record in records:
            arrivals.note(record)
            if record.kind is PacketKind.REPAIR:
                counts.update(repairs_sent=1, repair_bytes=record.size_bytes)

    def note_feedback(_view: str, feedback: Feedback, arrives_ns: int) -> None:
        asked, plis = len(feedback.nacks), int(feedback.pli)
        counts.update(nacks_sent=asked, plis_sent=plis)
        size_bytes = feedback.size_bytes + sum(each.size_bytes for each in feedback.arrivals)
        counts.update(receiver_reports_bytes=size_bytes)
        if arrives_ns <= START_NS + seconds * NS_PER_S + AFTER_NS:
            counts.update(nacks_arrived=asked, plis_arrived=plis)

    def note_encoded(frame: EncodedFrame) -> None:
        counts["keyframes_forced"] += frame.keyframe and frame.index > 0

    def note_shown(_frame: ShownFrame) -> None:
        counts["frames_shown"] += 1

    video = VirtualVideo(
        config.video,
        network,
        rule,
        seed,
        START_NS,
        _targets(config, network),
        config.policy.allocation.source_drop_below_kbps,
        VideoRecords(note_encoded, _ignore, note_shown, note, note_feedback),
        ProcessingTimes(0, 0),
        received,
        bool(received),
    )
    with closing(video):
        _drive(config, seconds, video.push, video.advance_to)
        for view in config.video.views:
            counts.update(lost_after_repair=_lost(video.receivers[view].decoder))
    counts.update(arrivals.counts())
    return counts


def run_rtpsession(
    config: Config,
    network: Network,
    rule: RepairRule,
    seed: int,
    seconds: int,
    received: Mapping[str, NotingFeedback],
) -> Counter[str]:
    """The real sessions on the same link."""
    gst.load().GLib.random_set_seed(seed)
    clock, events, waiter = SteppedClock(START_NS), EventQueue(), IdleWaiter()
    # also of the elements that ask for the system's clock
    gst.load().Gst.SystemClock.set_default(clock._clock)
    capacity = network_capacity(network, START_NS)
    arrivals = Arrivals(START_NS)
    link = NotingLink(arrivals, network, capacity, config.video.views, seed)
    targets = _targets(config, network)
    views = {
        view: RtpSessionView(
            view, config.video, rule, targets[view], link, events, clock, received.get(view)
        )
        for view in config.video.views
    }

    def settle() -> None:
        waiter.wait()
        for view in views.values():
            view.collect()

    def advance_to(now_ns: int) -> None:
        while True:
            wait_ns, action_ns = clock.next_ns(), events.next_ns
            due = [time for time in (wait_ns, action_ns) if time is not None and time <= now_ns]
            if not due:
                clock.move_to(now_ns)
                return
            clock.move_to(max(min(due), clock.now_ns()))
            if wait_ns is not None and wait_ns <= clock.now_ns():
                clock.end_next_wait()
            else:
                events.do_next()
            settle()

    def push(frame: Frame) -> None:
        views[frame.view].push(frame)
        settle()

    for each in views.values():
        each.start()
    settle()
    _drive(config, seconds, push, advance_to)
    counts = Counter(arrivals.counts())
    for each in views.values():
        counts.update(each.counts)
        counts.update(
            lost_after_repair=_lost(each.decoder),
            frames_shown=len(each.shown),
            keyframes_forced=each.keyframes_forced(),
        )
        for (end, size_bytes), datagrams in each.report_bytes.items():
            if end == "receiver":
                counts.update(receiver_reports_bytes=size_bytes * datagrams)
        print(each.view, dict(each.report_bytes), file=sys.stderr)
        each.close()
    waiter.close()
    return counts


def _lost(decoder: ViewDecoder) -> int:
    """Packets that were given up after repair."""
    lost: int = decoder.jitterbuffer.get_property("stats").get_value("num-lost")
    return lost


def _ignore(_: object) -> None:
    """Nothing of it is measured here."""


def _targets(config: Config, network: Network) -> dict[str, float]:
    """What the strategy `equal` gives each view."""
    capacity_kbps = network.rate_kbps or config.policy.budget.max_kbps
    budget_kbps = config.policy.budget.safety_factor * capacity_kbps
    return dict.fromkeys(config.video.views, budget_kbps / len(config.video.views))


def _drive(
    config: Config,
    seconds: int,
    push: Callable[[Frame], None],
    advance_to: Callable[[int], None],
) -> None:
    fps = config.video.fps
    for index in range(seconds * fps):
        now_ns = START_NS + index * NS_PER_S // fps
        advance_to(now_ns)
        for place, view in enumerate(config.video.views):
            push(Frame(view, index, now_ns, image(index + 40 * place)))
    advance_to(START_NS + seconds * NS_PER_S + AFTER_NS)


if __name__ == "__main__":
    main()
