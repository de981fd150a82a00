"""The live video: a sender for each view; in one process with its receivers, and the relay."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hw.camera import Camera
from tams_app.config import Config, Network
from tams_app.records import Frame, PacketRecord, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.session.faces import Faces
from tams_app.session.recorders import SessionRecords
from tams_app.session.video import Video
from tams_app.video.core.codecs import SOFTWARE, Codecs
from tams_app.video.live.receiver import VideoReceiver
from tams_app.video.live.relay_client import RelayClient
from tams_app.video.live.sender import VideoSender
from tams_app.video.live.udp import ViewPorts

_CAMERA_TIMEOUT_S = 0.2


class Senders(Video):
    """The senders of all views, live; where their packets go is for those who derive from it.

    Its callbacks come from several threads.
    """

    def __init__(
        self,
        config: Config,
        network: Network,
        clock: Clock,
        log: SessionRecords,
        on_captured: Callable[[Frame], None],
        show: Callable[[ShownFrame], None],
        epoch_ns: int | None = None,
        codecs: Codecs = SOFTWARE,
        faces: Faces | None = None,
    ) -> None:
        """A capacity trace begins at `epoch_ns`, by default now. `faces`: what shows the frames."""
        self._epoch_ns = clock.now_ns() if epoch_ns is None else epoch_ns
        super().__init__(
            config, network, clock, self._epoch_ns, log, on_captured, show, codecs, faces
        )
        self._config = config
        self._network = network
        self._senders: dict[str, VideoSender] = {}

    @abstractmethod
    def start(self) -> None:
        """Let the streams run."""

    def _make_sender(self, view: str) -> VideoSender:
        sender = VideoSender(
            view,
            self._config.video,
            self._rule.rtx,
            self._clock,
            self._start_kbps[view],
            self._source_drop_below_kbps,
            self._log.record,
            self._log.record,
            self._heard.get(view),
            self._feedback,
            self._parity.get(view),
            self.codecs.encoder,
            self.may_resend,
        )
        self._senders[view] = sender
        return sender

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def pad(self, size_bytes: int) -> None:
        self._senders[self._config.video.views[0]].pad(size_bytes)

    def behind_ns(self) -> int:
        """By how much the encoder that is furthest behind its camera is so."""
        return max(sender.behind_ns for sender in self._senders.values())

    def poll(self) -> str:
        return next(filter(None, [sender.poll() for sender in self._senders.values()]), "")

    def close(self) -> None:
        with ExitStack() as stack:  # one that fails keeps none of the others open
            for sender in self._senders.values():
                stack.callback(sender.close)

    @property
    @abstractmethod
    def relay_pid(self) -> int | None:
        """The process id of the relay that emulates the network; None where there is none."""

    def _send(self, frame: Frame, left_out: bool) -> None:
        self._senders[frame.view].push(frame, left_out)

    def _wire_bytes(self) -> int:
        return sum(sender.wire_bytes for sender in self._senders.values())


class Uplink(Senders):
    """The streams of all views over the emulated link, to receivers in this process."""

    def __init__(
        self,
        config: Config,
        network: Network,
        clock: Clock,
        log: SessionRecords,
        on_captured: Callable[[Frame], None],
        show: Callable[[ShownFrame], None],
        logs: Path,
        on_packets: Callable[[list[PacketRecord]], None],
        on_failure: Callable[[str, BaseException], None],
        epoch_ns: int | None = None,
        codecs: Codecs = SOFTWARE,
        faces: Faces | None = None,
    ) -> None:
        """A capacity trace begins at `epoch_ns`, by default now. `logs`: of the relay process.

        `faces`: what shows the frames.
        """
        super().__init__(config, network, clock, log, on_captured, show, epoch_ns, codecs, faces)
        self._logs = logs
        self._on_packets = on_packets
        self._on_failure = on_failure
        self.receivers: dict[str, VideoReceiver] = {}
        self._relay: RelayClient | None = None

    def start(self) -> None:
        """Bind the ends, start the relay between them, let the streams run."""
        config, exits = self._config, {}
        for view in config.video.views:
            sender = self._make_sender(view)
            receiver = VideoReceiver(
                view,
                config.video,
                self._rule,
                self._clock,
                sender.sent.find,
                self._on_shown,
                self._feedback,
                self.codecs.decoder,
            )
            self.receivers[view] = receiver
            exits[view] = ViewPorts(
                config.video.bind_host,
                receiver.rtp_port,
                receiver.reports_port,
                sender.feedback_port,
            )
        self._relay = RelayClient(
            self._network,
            exits,
            seed=config.seed,
            log_directory=self._logs,
            on_packets=self._on_packets,
            on_failure=self._on_failure,
            epoch_ns=self._epoch_ns,
        )
        entrances = self._relay.start()
        for view in config.video.views:
            self.receivers[view].start(entrances[view])
            self._senders[view].start(entrances[view])

    @property
    def relay_pid(self) -> int | None:
        return self._relay.pid if self._relay else None

    def shown(self, view: str) -> ShownFrame | None:
        return self.receivers[view].mailbox.latest()

    def poll(self) -> str:
        failures = [super().poll(), *(receiver.poll() for receiver in self.receivers.values())]
        return next(filter(None, failures), "")

    def close(self) -> None:
        with ExitStack() as stack:
            stack.callback(super().close)  # in the reverse order: the senders last
            for receiver in self.receivers.values():
                stack.callback(receiver.close)
            if self._relay is not None:
                stack.callback(self._relay.close)


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
