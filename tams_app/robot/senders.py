"""The live video of the robot's side: counted frames, a sender for each view, emulated network."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import astuple, dataclass, replace
from operator import sub

from hw.camera import Camera
from tams_app.config import LinkConfig, Network
from tams_app.recording.journal import Journal
from tams_app.records import CameraRates, Frame, LatencyState, PacketRecord
from tams_app.robot.ground import LiveGround
from tams_app.robot.status import StatusBoard
from tams_app.robot.video import TakeFrame, Video
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.live.networks import RelayClient
from tams_app.video.live.sender import VideoSender
from tams_app.video.live.udp import ViewPorts

PERIOD_NS = NS_PER_S


@dataclass(slots=True)
class _Count:
    """One view's frames since its first; written by its capture thread alone."""

    taken: int = 0
    overrun: int = 0  # the camera had them, the session did not take them
    damaged: int = 0  # they arrived so, and were left out


class FrameRates:
    """Counts frames, and records them once a second.

    `came` and `waits` are for each view's capture thread, `poll` for one other.
    """

    def __init__(self, views: Sequence[str], clock: Clock, log: Journal) -> None:
        self._clock = clock
        self._log = log
        self._counts = {view: _Count() for view in views}
        self._last_index: dict[str, int] = {}
        self._free_ns = dict.fromkeys(views, 0)  # when a thread began to wait for its next frame
        self._before: tuple[int, dict[str, _Count]] | None = None
        self.given_fps: Mapping[str, float] = {}  # by view, in the last period

    def came(self, frame: Frame) -> None:
        """Count a frame."""
        view, count = frame.view, self._counts[frame.view]
        count.damaged += frame.damaged
        if view in self._last_index:
            count.taken += 1
            if frame.capture_ns < self._free_ns[view]:  # it was there before it was waited for
                count.overrun += frame.index - self._last_index[view] - 1
        self._last_index[view] = frame.index

    def waits(self, view: str) -> None:
        """The last frame was handed on: its thread waits for the next one from now on."""
        self._free_ns[view] = self._clock.now_ns()

    def poll(self) -> None:
        """Record what came since the last period, once that is over."""
        now_ns = self._clock.now_ns()
        if self._before is not None and now_ns - self._before[0] < PERIOD_NS:
            return
        counts = {view: _Count(*astuple(count)) for view, count in self._counts.items()}
        if self._before is None:
            if any(not count.taken for count in counts.values()):
                return
            self._log.record(CameraRates(now_ns, {}, {}))
        else:
            before_ns, before = self._before
            passed_s = (now_ns - before_ns) / NS_PER_S
            since = {
                view: _Count(*map(sub, astuple(count), astuple(before[view])))
                for view, count in counts.items()
            }
            self.given_fps = {view: count.taken / passed_s for view, count in since.items()}
            overrun_fps = {view: count.overrun / passed_s for view, count in since.items()}
            damaged = {view: count.damaged for view, count in since.items()}
            self._log.record(CameraRates(now_ns, dict(self.given_fps), overrun_fps, damaged))
        self._before = now_ns, counts


_CAMERA_TIMEOUT_S = 0.2


class Senders(Video):
    """The streams of all views to an operator, over the emulated network if there is one.

    Bound when made. Once the operator's end is open too, `enter_network`, then `start`; the
    session's parts end it all.
    """

    def __init__(
        self,
        ground: LiveGround,
        network: Network,
        board: StatusBoard,
        captured: TakeFrame | None = None,
        epoch_ns: int | None = None,
        link: LinkConfig | None = None,
    ) -> None:
        """`network` is emulated, on top of the real one that `link` crosses; None: there is none.

        `board` gets the fates of packets in the emulated network, in a thread of their own.
        `captured` gets each camera's frame before it is sent. A capacity trace begins at
        `epoch_ns`, by default now.
        """
        clock, log = ground.clock, ground.log
        self._epoch_ns = clock.now_ns() if epoch_ns is None else epoch_ns
        crossed = network if link is None else behind(network, link)
        super().__init__(ground, crossed, self._epoch_ns, captured, link is not None)
        if link is not None:
            self.delay_ns += round(link.latency_ms * NS_PER_MS)  # what is shown must be reported
        self._config, self._parts, self._board = ground.config, ground.parts, board
        # without a link each packet's fate is recorded, also where nothing befalls it
        self._emulated = network if link is None or not _is_clear(network) else None
        self._senders: dict[str, VideoSender] = {}
        self._parts.stack.callback(self.close)
        for view, stream in self._streams.items():
            sender = VideoSender(stream, self._uplink, clock, log.record)
            self._senders[view] = sender

    @property
    def feedback(self) -> bool:
        """Receivers report each packet."""
        return self._uplink.feedback

    @property
    def sent(self) -> dict[str, SentFrames]:
        """By view, the identities of the frames that were sent."""
        return {view: sender.sent for view, sender in self._senders.items()}

    def enter_network(self, ports: Mapping[str, ViewPorts]) -> dict[str, ViewPorts]:
        """Begin to emulate the network, if there is one.

        `ports`: by view, where its packets are to arrive, with 0 as the port for feedback. Returned
        are those that packets and feedback are to be sent to.
        """
        ends = {
            view: replace(ports[view], feedback=sender.feedback_port)
            for view, sender in self._senders.items()
        }
        if self._emulated is None:
            return ends
        relay = RelayClient(self._parts.logs, self._on_packets, self._parts.on_failure)
        self._parts.stack.callback(relay.close)
        ends = relay.emulate(self._emulated, ends, self._config.seed, self._epoch_ns)
        if relay.process is not None and relay.process.pid is not None:
            self._parts.measure("relay", relay.process.pid)
        return ends

    def start(self, entrances: Mapping[str, ViewPorts]) -> None:
        """Let the streams run to `entrances`, by view."""
        for view, sender in self._senders.items():
            sender.start(entrances[view])

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def pad(self, size_bytes: int) -> None:
        self._senders[self._config.video.views[0]].pad(size_bytes)

    @property
    def latency(self) -> dict[str, LatencyState | None]:
        """By view, what its frames take here until their packets leave."""
        return {view: sender.stages.latency for view, sender in self._senders.items()}

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return next(filter(None, (sender.poll() for sender in self._senders.values())), "")

    def close(self) -> None:
        """Stop all streams; may be called twice."""
        with ExitStack() as stack:  # one that fails keeps none of the others open
            for sender in self._senders.values():
                stack.callback(sender.close)

    def _on_packets(self, packets: list[PacketRecord]) -> None:
        self._board.packets(packets)
        self._log.packets(packets)

    def _send(self, frame: Frame, left_out: bool) -> None:
        dropped = self._senders[frame.view].push(frame, left_out)
        if dropped is not None:
            self._log.record(dropped)

    def _wire_bytes(self) -> int:
        return sum(sender.wire_bytes for sender in self._senders.values())


class Capture:
    """Counts and sends the frames of one camera; the body of a Worker."""

    def __init__(self, camera: Camera, rates: FrameRates, video: Video) -> None:
        self._camera, self._rates, self._video = camera, rates, video

    def run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            frame = self._camera.next_frame(_CAMERA_TIMEOUT_S)
            if frame is not None:  # a frozen camera shows as stale video
                self._rates.came(frame)
                self._video.push(frame)
                self._rates.waits(frame.view)


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
