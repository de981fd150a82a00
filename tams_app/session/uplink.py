"""The three video streams over the link: senders, relay, receivers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from tams_app.config import Config, Network
from tams_app.records import (
    DroppedFrame,
    EncodedFrame,
    Frame,
    PacketRecord,
    Phase,
    ShownFrame,
)
from tams_app.runtime.clock import Clock
from tams_app.session.captures import CaptureTimes
from tams_app.video.ports import ViewPorts
from tams_app.video.receiver import VideoReceiver
from tams_app.video.relay_client import RelayClient
from tams_app.video.repair import RepairRule, repair_rule
from tams_app.video.sender import VideoSender


@dataclass(frozen=True, slots=True)
class UplinkRecords:
    """Where the uplink's events go; called from several threads, must not block."""

    encoded: Callable[[EncodedFrame], None]
    dropped: Callable[[DroppedFrame], None]
    shown: Callable[[ShownFrame], None]
    packets: Callable[[list[PacketRecord]], None]
    failed: Callable[[str, BaseException], None]


class Uplink:
    """All views of one session, from pushed frame to mailbox."""

    def __init__(
        self,
        config: Config,
        network: Network,
        epoch_ns: int,
        clock: Clock,
        records: UplinkRecords,
        logs: Path,
    ) -> None:
        """A capacity trace of `network` begins at `epoch_ns`."""
        self._config = config
        self._network = network
        self._epoch_ns = epoch_ns
        self._clock = clock
        self._records = records
        video = config.video
        self.rule: RepairRule = repair_rule(network, video.pli_min_interval_ms, video.repair)
        self.times = {view: CaptureTimes() for view in config.video.views}
        self.receivers: dict[str, VideoReceiver] = {}
        self._senders: dict[str, VideoSender] = {}
        self._relay: RelayClient | None = None
        self._logs = logs

    def start(self, start_kbps: dict[str, int]) -> None:
        """Bind the ends, start the relay between them, let the streams run."""
        config, exits = self._config, {}
        for view in config.video.views:
            receiver = VideoReceiver(
                view, config.video, self.rule, self._clock, self._records.shown
            )
            self.receivers[view] = receiver
            sender = VideoSender(
                view,
                config.video,
                self.rule.rtx,
                self._clock,
                start_kbps[view],
                config.policy.allocation.source_drop_below_kbps,
                self._records.encoded,
                self._records.dropped,
            )
            self._senders[view] = sender
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
            on_packets=self._records.packets,
            on_failure=self._records.failed,
            epoch_ns=self._epoch_ns,
        )
        entrances = self._relay.start()
        for view in config.video.views:
            self.receivers[view].start(entrances[view])
            self._senders[view].start(entrances[view])

    @property
    def relay_pid(self) -> int | None:
        """The relay's process id; None before the start."""
        return self._relay.pid if self._relay else None

    def push(self, frame: Frame) -> None:
        """Send a captured frame."""
        self._senders[frame.view].push(frame)

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        """The wire rate each view is to meet from now on."""
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far, all views together."""
        return sum(sender.stats().wire_bytes for sender in self._senders.values())

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the frame shown of `view`; None before the first, and if nobody knows."""
        return self.times[view].age_ns(self.receivers[view].mailbox.latest(), now_ns)

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        failures = [sender.poll() for sender in self._senders.values()]
        failures += [receiver.poll() for receiver in self.receivers.values()]
        return next(filter(None, failures), "")

    def close(self) -> None:
        """Stop everything that was started."""
        with ExitStack() as stack:  # one that fails keeps none of the others open
            if self._relay is not None:
                stack.callback(self._relay.close)
            for receiver in self.receivers.values():
                stack.callback(receiver.close)
            for sender in self._senders.values():
                stack.callback(sender.close)


class VideoAges(Protocol):
    """Knows how old the shown frames are."""

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the frame shown of `view`; None before the first, and if nobody knows."""


def primary_age_ns(
    ages: VideoAges,
    primary: Callable[[Phase], str],
    camera_delays_ns: Mapping[str, int] = MappingProxyType({}),
) -> Callable[[int, Phase], int]:
    """Age of the shown primary view of a phase; endless before the first frame.

    `camera_delays_ns`: by view, what passed from the light to the capture time stamp.
    """
    endless_ns = 1 << 62

    def age_ns(now_ns: int, phase: Phase) -> int:
        view = primary(phase)
        age = ages.age_ns(view, now_ns)
        return endless_ns if age is None else age + camera_delays_ns.get(view, 0)

    return age_ns
