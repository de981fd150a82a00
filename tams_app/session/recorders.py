"""Everything the session leaves behind while it runs: the log and, if wanted, lossless captures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from tams_app import __version__
from tams_app.capacity import Capacity
from tams_app.config import Config
from tams_app.recording import Facts, Header, Recorder, ReferenceRecorder
from tams_app.recording.topics import Recordable
from tams_app.records import Frame, LinkCapacity, PacketRecord, PhaseChange
from tams_app.runtime.clock import Clock

LOG_NAME = "session.mcap"
REFERENCE_NAME = "reference.mcap"


class Log(Protocol):
    """Keeps records; a frame's pixels are let go."""

    def record(self, item: Recordable) -> None:
        """Keep one record."""

    def record_all(self, items: Iterable[Recordable]) -> None:
        """Keep several records."""


class SessionRecords:
    """What a session tells its log: live (`Recorders`) and in virtual time."""

    def __init__(self, clock: Clock, log: Log, reference: ReferenceRecorder | None = None) -> None:
        self._clock = clock
        self._log = log
        self._reference = reference
        self._last_capacity_kbps: float | None = None
        self._capacity_ns = clock.now_ns()

    def record(self, item: Recordable) -> None:
        """Keep one record in the log."""
        self._log.record(item)

    def packets(self, packets: list[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""
        self._log.record_all(packets)

    def capture(self, frame: Frame) -> None:
        """Keep a captured frame's time, and its pixels if that was asked for."""
        self._log.record(frame)
        if self._reference is not None:
            self._reference.record(frame)

    def phase(self, change: PhaseChange) -> None:
        """Keep the beginning of a phase."""
        self._log.record(change)

    def fact(self, name: str, value: str) -> None:
        """Keep something that was learned after the start."""
        self._log.record(Facts(self._clock.now_ns(), {name: value}))

    def capacity(self, now_ns: int, capacity: Capacity) -> None:
        """Keep what the link has truly carried since the last call, when that has changed."""
        kbps = capacity.mean_kbps(self._capacity_ns, now_ns)
        self._capacity_ns = now_ns
        if kbps != self._last_capacity_kbps:
            self._last_capacity_kbps = kbps
            self._log.record(LinkCapacity(now_ns, kbps))


class Recorders(SessionRecords):
    """The log and the reference recorder of one session; nothing here blocks but `close`."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        on_failure: Callable[[str, BaseException], None],
    ) -> None:
        started_ns = clock.now_ns()
        wall_offset_ns = time.time_ns() - started_ns
        header = session_header(config, started_ns, wall_offset_ns)
        free_mb, bitstream = config.recording.min_free_mb, config.recording.bitstream
        reference: ReferenceRecorder | None = None
        with ExitStack() as stack:
            log = Recorder(folder / LOG_NAME, header, clock, free_mb, on_failure, bitstream)
            stack.callback(log.close)
            if config.recording.record_reference:
                reference = ReferenceRecorder(
                    folder / REFERENCE_NAME, wall_offset_ns, free_mb, on_failure
                )
                stack.callback(reference.close)
                reference.start()
            log.start()
            self._stack = stack.pop_all()
        super().__init__(clock, log, reference)

    def close(self) -> None:
        """Write what is queued and finish the files."""
        self._stack.close()


def session_header(config: Config, started_ns: int, wall_offset_ns: int) -> Header:
    """The first message of a session's log."""
    return Header(
        version=__version__,
        name=config.name,
        seed=config.seed,
        strategy=config.strategy,
        network=config.network,
        budget_mode=config.policy.budget.mode,
        servo=config.arm.servo,
        control_rate_hz=config.control.rate_hz,
        views=config.video.views,
        fps=config.video.fps,
        weights=config.policy.weights.matrix,
        started_ns=started_ns,
        wall_offset_ns=wall_offset_ns,
        config=config.model_dump(mode="json"),
    )
