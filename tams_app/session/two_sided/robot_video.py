"""The robot's side of the video: senders, whose packets leave by the link."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tams_app.config import Config, LinkConfig, Network
from tams_app.link.gateway import Routes
from tams_app.records import Frame, PacketRecord, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.session.recorders import SessionRecords
from tams_app.session.two_sided.robot_link import RobotLink
from tams_app.session.uplink import Senders
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import SOFTWARE, Codecs
from tams_app.video.core.packets import receiver_ssrc
from tams_app.video.live.relay_client import RelayClient
from tams_app.video.live.udp import ViewPorts


class RobotVideo(Senders):
    """The streams of all views to the operator's side, over the emulated network if there is one.

    Which frame counts there it knows from the operator's side, by its RTP timestamp: its age counts
    from its capture until now, so that it is never taken for younger than it is.
    """

    def __init__(
        self,
        config: Config,
        network: Network,
        clock: Clock,
        log: SessionRecords,
        on_captured: Callable[[Frame], None],
        logs: Path,
        on_packets: Callable[[list[PacketRecord]], None],
        on_failure: Callable[[str, BaseException], None],
        link: RobotLink,
        codecs: Codecs = SOFTWARE,
    ) -> None:
        """`network` is emulated, on top of the network that the link crosses."""
        super().__init__(
            config,
            behind(network, config.link),
            clock,
            log,
            on_captured,
            _show_nothing,
            codecs=codecs,
        )
        self.delay_ns += round(config.link.latency_ms * NS_PER_MS)  # what is shown must be told
        self._emulated = network
        self._logs, self._on_packets, self._on_failure = logs, on_packets, on_failure
        self._link = link
        self._relay: RelayClient | None = None
        self._captured_ns: dict[str, int] = {}  # by view, of the frame that is shown

    def start(self) -> None:
        """Bind the senders' ports, open the link, let the streams run."""
        video = self._config.video
        senders = {view: self._make_sender(view) for view in video.views}
        entrance = self._link.open(
            self._rule, self._feedback, lambda view: senders[view].sent.first_ns
        )
        ends = {
            view: ViewPorts(video.bind_host, entrance, entrance, sender.feedback_port)
            for view, sender in senders.items()
        }
        if not _is_clear(self._emulated):
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
        ports = {receiver_ssrc(video, view): one.feedback for view, one in ends.items()}
        self._link.follow(Routes(rtp={}, rtcp=ports))
        for view, sender in senders.items():
            sender.start(ends[view])

    @property
    def relay_pid(self) -> int | None:
        return self._relay.pid if self._relay else None

    def shown(self, view: str) -> ShownFrame | None:
        return None

    def age_ns(self, view: str, now_ns: int) -> int | None:
        timestamp = self._link.shown_timestamp(view)
        sent = None if timestamp is None else self._senders[view].sent.find(timestamp)
        if sent is not None:
            self._captured_ns[view] = sent.capture_ns
        captured_ns = self._captured_ns.get(view)
        return None if captured_ns is None else now_ns - captured_ns

    def is_damaged(self, view: str) -> bool:
        return self._link.shows_damage(view)

    def close(self) -> None:
        with ExitStack() as stack:
            stack.callback(super().close)
            if self._relay is not None:
                stack.callback(self._relay.close)


def behind(network: Network, link: LinkConfig) -> Network:
    """The emulated network with the real one behind it, for the rule of repair."""
    return network.model_copy(
        update={
            "latency_ms": network.latency_ms + link.latency_ms,
            "jitter_ms": network.jitter_ms + link.jitter_ms,
        }
    )


def _show_nothing(_shown: ShownFrame) -> None:
    """On this side nothing is decoded."""


def _is_clear(network: Network) -> bool:
    """Whether it changes nothing."""
    delays = network.latency_ms or network.jitter_ms or network.loss
    return not delays and network.rate_kbps is None and network.trace is None
