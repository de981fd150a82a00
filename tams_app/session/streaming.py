"""From the cameras to the operator's eyes: captures, streams, and the policy that feeds them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from hw.camera import Camera
from tams_app.config import Config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Allocation, Frame, PacketRecord, Phase, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.session import build
from tams_app.session.allocating import Allocating
from tams_app.session.captures import Capture
from tams_app.session.devices import Note
from tams_app.session.quality import LiveQuality
from tams_app.session.recorders import Recorders
from tams_app.session.status import StatusBoard, StatusSnapshot
from tams_app.session.uplink import Uplink, UplinkRecords, primary_age_ns
from tams_app.video.networks import network_capacity, resolve_network

Run = Callable[[str, Callable[[threading.Event], None]], object]  # starts a named thread


class Streaming:
    """All views of one session: the uplink first, the cameras when everything else is there."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        recorders: Recorders,
        board: StatusBoard,
        on_failure: Callable[[str, BaseException], None],
        note: Note,
    ) -> None:
        self._config = config
        self._clock = clock
        self._recorders = recorders
        self._board = board
        self._on_failure = on_failure
        self._note = note
        self._stack = ExitStack()
        self._weights = WeightMatrix(config.policy.weights.matrix)

    def start(self, logs: Path) -> None:
        """Start relay, senders, receivers and who compares frames; nothing is captured yet."""
        config, clock, record = self._config, self._clock, self._recorders.record
        self._quality = LiveQuality(config.video, logs, record, self._note)
        self._stack.callback(self._quality.close)
        self._quality.start()  # takes a moment, of which a capacity trace must lose nothing
        network = resolve_network(config, config.network)
        epoch_ns = clock.now_ns()
        self._capacity = network_capacity(network, epoch_ns)
        allocating = Allocating(config, self._capacity, self._recorders)
        records = UplinkRecords(
            encoded=record,
            dropped=record,
            shown=self._on_shown,
            packets=self._on_packets,
            failed=self._on_failure,
        )
        self._uplink = Uplink(config, network, epoch_ns, clock, records, logs)
        self._stack.callback(self._uplink.close)
        self._uplink.start(allocating.start_kbps(epoch_ns))
        self._policy_loop = allocating.loop(clock, self._uplink, self._on_allocation)
        self.video_delay_ns = build.video_delay_ns(network, self._uplink.rule)

    def run(self, cameras: list[Camera], run: Run) -> None:
        """Start the cameras, a thread for each, and the policy's."""
        run("policy", self._policy_loop.run)
        for camera in cameras:
            camera.start()
            self._stack.callback(camera.close)
            times = self._uplink.times[camera.view]
            consumers: list[Callable[[Frame], None]]
            consumers = [self._recorders.capture, self._quality.push_capture, self._push]
            capture = Capture(camera, times, consumers)
            run(f"capture-{camera.view}", capture.run)

    @property
    def helper_pids(self) -> dict[str, int | None]:
        """Process ids of the relay and of who compares frames; None where there is none."""
        return {"relay": self._uplink.relay_pid, "quality": self._quality.pid}

    @property
    def primary_age_ns(self) -> Callable[[int, Phase], int]:
        """Tells the age of the shown primary view of a phase at a time [ns]."""
        delays_ns = build.camera_delays_ns(self._config)
        return primary_age_ns(self._uplink, self._weights.primary_view, delays_ns)

    def enter(self, phase: Phase) -> None:
        """A phase began: allocate anew at once. In the control thread; does not block."""
        self._policy_loop.enter(phase)

    def shown(self, view: str) -> ShownFrame | None:
        """The newest frame of `view`."""
        return self._uplink.receivers[view].mailbox.latest()

    def snapshot(self, now_ns: int, elapsed_s: float) -> StatusSnapshot:
        """What the console shows at this moment."""
        snapshot = self._board.snapshot(now_ns, elapsed_s, self._uplink, self._capacity)
        primary = self._weights.primary_view(self._board.phase)
        live_ssim = self._quality.recent_live(primary, now_ns)
        return replace(snapshot, primary_view=primary, live_ssim=live_ssim)

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return self._uplink.poll()

    def close(self) -> None:
        """Close cameras and streams; the threads of `run` must have ended."""
        self._stack.close()

    def _on_shown(self, shown: ShownFrame) -> None:
        self._recorders.record(shown)
        self._quality.push_shown(shown)

    def _push(self, frame: Frame) -> None:
        self._uplink.push(frame)

    def _on_allocation(self, allocation: Allocation) -> None:
        self._board.allocation = allocation

    def _on_packets(self, packets: list[PacketRecord]) -> None:
        self._board.packets(packets)
        self._recorders.packets(packets)
