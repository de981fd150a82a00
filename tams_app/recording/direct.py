"""A session log written at once, by the thread that records: for virtual time."""

from __future__ import annotations

from pathlib import Path

from tams_app.recording.disk import RESERVE_FRACTION, require_free_space, require_reserve
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.topics import Header, PacketBatch, Recordable
from tams_app.recording.writer import SPACE_CHECK_NS, without_pixels
from tams_app.records import Frame, PacketRecord, ShownFrame
from tams_app.runtime.clock import NS_PER_MS, Clock

BATCH_NS = 50 * NS_PER_MS  # of packets in one message; live it is what the writer's thread finds


class DirectRecorder:
    """Keeps what a `Recorder` keeps, without thread, queue or loss.

    The same records at the same times make the same file, byte by byte. Not thread safe.
    """

    def __init__(
        self, path: Path, header: Header, clock: Clock, min_free_mb: float, bitstream: bool = True
    ) -> None:
        """Create the file and write the header; LogError if there is no space or no folder."""
        require_free_space(path.parent, min_free_mb)
        self._clock = clock
        self._directory = path.parent
        self._reserve_mb = min_free_mb * RESERVE_FRACTION
        self._log = McapLog(path, header, bitstream)
        self._packets: list[PacketRecord] = []
        self._next_batch_ns = clock.now_ns() + BATCH_NS
        self._next_check_ns = clock.now_ns() + SPACE_CHECK_NS

    def record(self, item: Recordable) -> None:
        """Write one record; LogError if the disk is full or fails."""
        if isinstance(item, PacketRecord):
            self._packets.append(item)
            return
        now_ns = self._clock.now_ns()
        if now_ns >= self._next_batch_ns:
            self._next_batch_ns = now_ns + BATCH_NS
            self._write_packets()
        if now_ns >= self._next_check_ns:
            self._next_check_ns = now_ns + SPACE_CHECK_NS
            self._log.flush()
            require_reserve(self._directory, self._reserve_mb)
        kept = without_pixels(item) if isinstance(item, Frame | ShownFrame) else item
        self._log.write(kept, now_ns)

    def close(self) -> None:
        """Write what is left and finish the file; may be called twice."""
        self._write_packets()
        self._log.close()

    def _write_packets(self) -> None:
        if self._packets:
            packets, self._packets = self._packets, []
            self._log.write(PacketBatch.of(packets), self._clock.now_ns())
