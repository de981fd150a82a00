"""The live video of the robot's side: a sender for each view, and the network that is emulated."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from hw.camera import Camera
from tams_app.config import Config, LinkConfig, Network
from tams_app.recording.journal import Journal
from tams_app.records import Frame, LatencyState, PacketRecord
from tams_app.robot.operator import StreamedOperator
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import SOFTWARE, Codecs
from tams_app.video.live.relay import RelayClient
from tams_app.video.live.sender import VideoSender

_CAMERA_TIMEOUT_S = 0.2


class Senders(Video):
    """The streams of all views to an operator, over the emulated network if there is one.

    Its callbacks come from several threads.
    """

    def __init__(
        self,
        config: Config,
        network: Network,
        clock: Clock,
        log: Journal,
        on_captured: Callable[[Frame], None],
        operator: StreamedOperator,
        logs: Path,
        on_packets: Callable[[list[PacketRecord]], None],
        on_failure: Callable[[str, BaseException], None],
        epoch_ns: int | None = None,
        codecs: Codecs = SOFTWARE,
        link: LinkConfig | None = None,
    ) -> None:
        """`network` is emulated, on top of the real one that `link` crosses; None: there is none.

        A capacity trace begins at `epoch_ns`, by default now. `logs`: of the relay process.
        `on_packets` gets the fates of packets in the emulated network.
        """
        self._epoch_ns = clock.now_ns() if epoch_ns is None else epoch_ns
        crossed = network if link is None else behind(network, link)
        real = link is not None
        super().__init__(config, crossed, clock, self._epoch_ns, log, on_captured, codecs, real)
        if link is not None:
            self.delay_ns += round(link.latency_ms * NS_PER_MS)  # what is shown must be reported
        self._config = config
        self._operator = operator
        self._senders: dict[str, VideoSender] = {}
        # without a link each packet's fate is recorded, also where nothing befalls it
        self._emulated = network if link is None or not _is_clear(network) else None
        self._logs, self._on_packets, self._on_failure = logs, on_packets, on_failure
        self._relay: RelayClient | None = None

    def start(self) -> None:
        """Bind the senders' ports, open the operator's end, let the streams run."""
        senders = {view: self._make_sender(view) for view in self._config.video.views}
        sent = {view: sender.sent for view, sender in senders.items()}
        ends = self._operator.open(self._rule, self._uplink.feedback, sent)
        ends = {
            view: replace(ends[view], feedback=one.feedback_port) for view, one in senders.items()
        }
        if self._emulated is not None:
            self._relay = RelayClient(
                self._emulated,
                ends,
                seed=self._config.seed,
                log_directory=self._logs,
                on_packets=self._on_packets,
                on_failure=self._on_failure,
                epoch_ns=self._epoch_ns,
            )
            ends = self._relay.start()
        self._operator.connect(ends)
        for view, sender in senders.items():
            sender.start(ends[view])

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def pad(self, size_bytes: int) -> None:
        self._senders[self._config.video.views[0]].pad(size_bytes)

    @property
    def latency(self) -> dict[str, LatencyState | None]:
        """By view, what its frames take here until their packets leave."""
        return {view: sender.stages.latency for view, sender in self._senders.items()}

    @property
    def relay_pid(self) -> int | None:
        """The process id of the relay that emulates the network; None where there is none."""
        return self._relay.pid if self._relay else None

    def poll(self) -> str:
        return next(filter(None, (sender.poll() for sender in self._senders.values())), "")

    def close(self) -> None:
        with ExitStack() as stack:  # one that fails keeps none of the others open
            for sender in self._senders.values():
                stack.callback(sender.close)
            stack.callback(self._operator.close)
            if self._relay is not None:
                stack.callback(self._relay.close)

    def _make_sender(self, view: str) -> VideoSender:
        record = self._log.record
        sender = VideoSender(self._streams[view], self._clock, record, record, self._uplink)
        self._senders[view] = sender
        return sender

    def _send(self, frame: Frame, left_out: bool) -> None:
        self._senders[frame.view].push(frame, left_out)

    def _wire_bytes(self) -> int:
        return sum(sender.wire_bytes for sender in self._senders.values())


class Capture:
    """Hands the frames of one camera on; the body of a Worker."""

    def __init__(self, camera: Camera, consume: Callable[[Frame], None]) -> None:
        self._camera = camera
        self._consume = consume

    def run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            frame = self._camera.next_frame(_CAMERA_TIMEOUT_S)
            if frame is not None:  # a frozen camera shows as stale video
                self._consume(frame)


def behind(network: Network, link: LinkConfig) -> Network:
    """The emulated network with the real one behind it, for the rule of repair."""
    return network.model_copy(
        update={
            "latency_ms": network.latency_ms + link.latency_ms,
            "jitter_ms": network.jitter_ms + link.jitter_ms,
        }
    )


def _is_clear(network: Network) -> bool:
    """True if it changes nothing."""
    delays = network.latency_ms or network.jitter_ms or network.loss
    return not delays and network.rate_kbps is None and network.trace is None
