"""One end of `tbf`, in a process of its own inside its network namespace: senders or receivers."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np

from benchmarks.experiments.moving_frames import image
from tams_app.config import Config, Network, load_config
from tams_app.records import Frame, PacketArrival, UplinkReport
from tams_app.robot.policy_loop import PolicyLoop
from tams_app.robot.session_records import SessionRecords
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import repair_rule
from tams_app.video.live.receiver import VideoReceiver
from tams_app.video.live.sender import VideoSender
from tams_app.video.live.udp import ViewPorts, requested_ports

SENDER_HOST, RECEIVER_HOST = "10.213.8.1", "10.213.8.2"
INTERFACE = "va"  # of the sender, with the bottleneck on its way out
_FIRST_PORT = 46_000
_UNKNOWN = Network()  # neither end is told of the bottleneck


def main() -> None:
    """Send and measure, or receive until the other side is done."""
    helper = HelperSide()
    asked = helper.specification
    with ExitStack() as stack:
        if asked["end"] == "receivers":
            receive(stack)
            helper.ready()
            helper.stop_requested.wait()
        else:
            send = Sending(stack)
            helper.ready()
            send.frames(asked["startup_s"], helper)
            helper.ready(**send.measured(asked["seconds"], helper))


def receive(stack: ExitStack) -> None:
    """The receivers of all views; the frames go nowhere, what came when is told to the senders."""
    config = _config(RECEIVER_HOST).video
    rule = repair_rule(_UNKNOWN, config.pli_min_interval_ms, config.repair, config.latency_bound_ms)
    clock = MonotonicClock()
    for view in config.views:
        receiver = VideoReceiver(
            view, config, rule, clock, lambda _timestamp: None, _ignore, feedback=True
        )
        stack.callback(receiver.close)
        receiver.start(_ports(config, view, SENDER_HOST))


class Sending:
    """Cameras, senders and policy loop of a session, without an operator."""

    def __init__(self, stack: ExitStack) -> None:
        config, self._clock = _config(SENDER_HOST), MonotonicClock()
        log = SessionRecords(self._clock, _NoLog())
        self._video = _Senders(config, self._clock, log)
        stack.callback(self._video.close)
        self._video.start()
        self._views = config.video.views
        self._period_ns = NS_PER_S // (config.video.fps * len(self._views))
        self._pushed = 0
        self._policy = Worker("policy", PolicyLoop(config, self._clock, self._video, log).run)
        stack.callback(self._policy.stop)
        self._policy.start()

    def frames(self, seconds: float, helper: HelperSide) -> None:
        """Push the views' frames in turn for so long."""
        due_ns = self._clock.now_ns()
        end_ns = due_ns + round(seconds * NS_PER_S)
        while due_ns < end_ns and not helper.stop_requested.is_set():
            self._clock.sleep_until_ns(due_ns)
            index, number = divmod(self._pushed, len(self._views))
            picture = image(index + 1000 * number)  # each view is elsewhere in the scene
            now_ns = self._clock.now_ns()
            self._video.push(Frame(self._views[number], index, now_ns, picture))
            self._pushed += 1
            due_ns = max(due_ns + self._period_ns, now_ns - NS_PER_S // 10)
        if reason := self._video.poll():
            raise RuntimeError(reason)

    def measured(self, seconds: float, helper: HelperSide) -> dict[str, Any]:
        """Go on for so long: what left the bottleneck, and how long its packets waited."""
        before, from_ns = _bottleneck(), self._clock.now_ns()
        self.frames(seconds, helper)
        after, to_ns = _bottleneck(), self._clock.now_ns()
        told = [
            (one.sent_ns, one.arrived_ns - one.sent_ns)
            for one in self._video.arrivals
            if one.arrived_ns is not None
        ]
        least_ns = min(transit_ns for _, transit_ns in told)
        waits_ms = [(transit - least_ns) / NS_PER_MS for sent, transit in told if sent >= from_ns]
        p50, p95, most = np.percentile(waits_ms, (50, 95, 100))
        sent = after["packets"] - before["packets"]
        dropped = after["drops"] - before["drops"]
        return {
            "left_kbps": (after["bytes"] - before["bytes"]) * 8e6 / (to_ns - from_ns),
            "dropped_fraction": dropped / max(sent + dropped, 1),
            "queue_ms": {"p50": p50, "p95": p95, "max": most},
        }


class _Senders(Video):
    """The sending half of a session's video."""

    def __init__(self, config: Config, clock: Clock, log: SessionRecords) -> None:
        super().__init__(config, _UNKNOWN, clock, clock.now_ns(), log, _ignore)
        self.arrivals: list[PacketArrival] = []
        self._config = config.video
        self._senders = {
            view: VideoSender(
                view,
                config.video,
                self._rule.rtx,
                clock,
                self._start_kbps[view],
                self._source_drop_below_kbps,
                _ignore,
                _ignore,
                self._received.get(view),
                self._feedback,
                self._parity.get(view),
                may_resend=self.may_resend,
                pacer=self._pacer,
            )
            for view in config.video.views
        }

    def start(self) -> None:
        for view, sender in self._senders.items():
            sender.start(_ports(self._config, view, RECEIVER_HOST))

    def report(self, now_ns: int) -> UplinkReport:
        report = super().report(now_ns)
        self.arrivals += report.arrivals
        return report

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def pad(self, size_bytes: int) -> None:
        self._senders[self._config.views[0]].pad(size_bytes)

    def poll(self) -> str:
        return next(filter(None, (sender.poll() for sender in self._senders.values())), "")

    def close(self) -> None:
        for sender in self._senders.values():
            sender.close()

    def _send(self, frame: Frame, left_out: bool) -> None:
        self._senders[frame.view].push(frame, left_out)

    def _wire_bytes(self) -> int:
        return sum(sender.wire_bytes for sender in self._senders.values())


class _NoLog:
    def record(self, item: object) -> None:
        pass

    def record_packets(self, packets: object) -> None:
        pass


_ignore: Callable[[object], None] = lambda _item: None  # noqa: E731


def _config(host: str) -> Config:
    return load_config(
        None,
        {
            "video.bind_host": host,
            "video.first_port": _FIRST_PORT,
            "policy.budget.mode": "feedback",
        },
    )


def _ports(config: Any, view: str, host: str) -> ViewPorts:
    """The ports of a view at the other end."""
    ports = requested_ports(config, view)
    return ViewPorts(host, ports.rtp, ports.reports, ports.feedback)


def _bottleneck() -> dict[str, int]:
    """The kernel's own count of what left the bottleneck and what it dropped."""
    command = ["tc", "-s", "-j", "qdisc", "show", "dev", INTERFACE, "root"]
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    counts: dict[str, int] = json.loads(told.stdout)[0]
    return counts


if __name__ == "__main__":
    main()
