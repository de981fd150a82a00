"""From the cameras to the operator's eyes: captures, streams, and the policy that feeds them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hw.camera import Camera
from tams_app.clock import Clock
from tams_app.config import Config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Allocation, Frame, PacketRecord, Phase, ShownFrame
from tams_app.session import build
from tams_app.session.captures import Capture
from tams_app.session.policy_loop import PolicyLoop
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
    ) -> None:
        self._config = config
        self._clock = clock
        self._recorders = recorders
        self._board = board
        self._on_failure = on_failure
        self._stack = ExitStack()
        self._weights = WeightMatrix(config.policy.weights.matrix)

    def start(self, logs: Path) -> None:
        """Start relay, senders and receivers; nothing is captured yet."""
        config, clock = self._config, self._clock
        network = resolve_network(config, config.network)
        epoch_ns = clock.now_ns()
        self._capacity = network_capacity(network, epoch_ns)
        self._policy, self._sender_budget = build.policy(config, self._capacity)
        record = self._recorders.record
        records = UplinkRecords(
            encoded=record,
            dropped=record,
            shown=record,
            packets=self._on_packets,
            failed=self._on_failure,
        )
        self._uplink = Uplink(config, network, epoch_ns, clock, records, logs)
        self._stack.callback(self._uplink.close)
        self._uplink.start(self._policy.step(epoch_ns, Phase.REACH).target_kbps)
        self._policy_loop = PolicyLoop(
            clock, config.policy.rate_hz, self._policy, self._before_policy, self._apply
        )
        self.picture_delay_ns = build.picture_delay_ns(network, self._uplink.rule)

    def run(self, cameras: list[Camera], run: Run) -> None:
        """Start the cameras, a thread for each, and the policy's."""
        run("policy", self._policy_loop.run)
        for camera in cameras:
            camera.start()
            self._stack.callback(camera.close)
            times = self._uplink.times[camera.view]
            capture = Capture(camera, times, [self._recorders.capture, self._push])
            run(f"capture-{camera.view}", capture.run)

    @property
    def relay_pid(self) -> int | None:
        """The relay's process id; None before the start."""
        return self._uplink.relay_pid

    @property
    def primary_age_ns(self) -> Callable[[int, Phase], int]:
        """Tells the age of the shown primary view of a phase at a time [ns]."""
        return primary_age_ns(self._uplink, self._weights.primary_view)

    def enter(self, phase: Phase) -> None:
        """A phase began: allocate anew at once. In the control thread; does not block."""
        self._policy_loop.enter(phase)

    def shown(self, view: str) -> ShownFrame | None:
        """The newest picture of `view`."""
        return self._uplink.receivers[view].mailbox.latest()

    def snapshot(self, now_ns: int, elapsed_s: float) -> StatusSnapshot:
        """What the console shows at this moment."""
        return self._board.snapshot(now_ns, elapsed_s, self._uplink, self._capacity)

    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""
        return self._uplink.poll()

    def close(self) -> None:
        """Close cameras and streams; the threads of `run` must have ended."""
        self._stack.close()

    def _push(self, frame: Frame) -> None:
        self._uplink.push(frame)

    def _before_policy(self, now_ns: int) -> None:
        if self._sender_budget is not None:
            self._sender_budget.observe(now_ns, self._uplink.wire_bytes())
        self._recorders.capacity(now_ns, self._capacity)

    def _apply(self, allocation: Allocation) -> None:
        self._uplink.set_targets(allocation.target_kbps)
        self._board.allocation = allocation
        self._recorders.record(allocation)

    def _on_packets(self, packets: list[PacketRecord]) -> None:
        self._board.packets(packets)
        self._recorders.packets(packets)
