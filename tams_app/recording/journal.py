"""What the parts of a session record in its log, and have at hand of it; and who writes it.

A `Recorder` takes records from any thread and writes them in its own, a `DirectRecorder` at once.
Chunks go to the system at least every `FLUSH_NS`, so that a killed session loses less than a
second.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from tams_app.capacity import Capacity
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.topics import Facts, FrameCaptured, FrameShown, PacketBatch, RecordsLost
from tams_app.records import Frame, LinkCapacity, Newest, Note, PacketRecord, Record, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS, NS_PER_S

if TYPE_CHECKING:  # few sessions keep them
    from tams_app.recording.reference import ReferenceRecorder


class Journal(ABC):
    """Records, sentences and facts of one session; what writes its log derives from it.

    `newest`: the newest record of each type.
    """

    def __init__(self, clock: Clock, show: Callable[[str], None] = lambda _text: None) -> None:
        """`show` gets the text of each note, too."""
        self._clock = clock
        self._show = show
        self.reference: ReferenceRecorder | None = None  # gets each captured frame, too
        self.newest = Newest()
        self._last_capacity_kbps: float | None = None
        self._capacity_ns = clock.now_ns()

    def record(self, item: Record) -> None:
        """Keep one record, have it at hand as the newest of its type, and show a sentence."""
        self.newest.put(item)
        if isinstance(item, Note):
            self._show(item.text)
        self.keep(item)

    @abstractmethod
    def keep(self, item: Record) -> None:
        """Keep one record in the log; a frame's pixels are let go."""

    @abstractmethod
    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""

    def capture(self, frame: Frame) -> None:
        """Keep a captured frame's time, and its pixels if that was asked for."""
        self.keep(frame)
        if self.reference is not None:
            self.reference.record(frame)

    def capacity(self, now_ns: int, capacity: Capacity) -> None:
        """Keep what the link has truly carried since the last call, when that has changed."""
        kbps = capacity.mean_kbps(self._capacity_ns, now_ns)
        self._capacity_ns = now_ns
        if kbps != self._last_capacity_kbps:
            self._last_capacity_kbps = kbps
            self.record(LinkCapacity(now_ns, kbps))

    def note(self, level: str, text: str) -> None:
        """Keep a sentence for people; `level` is info, warning or error."""
        self.record(Note(self._clock.now_ns(), level, text))

    def fact(self, name: str, value: str) -> None:
        """Keep something that was learned after the start; a later value of the name counts."""
        self.keep(Facts(self._clock.now_ns(), {name: value}))


CAPACITY = 20_000  # records waiting: more than ten seconds of a full session
POLL_S = 0.05  # waking per record would cost a switch of threads each
SLICE_S = 0.0003  # the writer lets go of the GIL at least this often ...
PAUSE_S = 0.0002  # ... for this long: a control tick never waits longer for it
LOST = "records are missing from the log: its disk is too slow or stood still"
FLUSH_NS = 800 * NS_PER_MS
SPACE_CHECK_NS = NS_PER_S
HANGS_NS = 2 * NS_PER_S  # what waits then still has room
BATCH_NS = 50 * NS_PER_MS  # of packets in one message of a direct recorder


class Recorder(Journal):
    """Writes one session log, which it closes in the end.

    Nothing here but `close` ever blocks, in any thread: what finds the queue full is dropped and
    counted. `on_failure(thread name, LogError)` is called once, in the recorder's thread, when the
    disk is full or fails; what was written stays readable.
    """

    def __init__(
        self,
        log: McapLog,
        clock: Clock,
        on_failure: Callable[[str, BaseException], None],
        show: Callable[[str], None] = lambda _text: None,
    ) -> None:
        super().__init__(clock, show)
        self._log = log
        self._queue: BoundedQueue[Record] = BoundedQueue(CAPACITY)
        self._worker = Worker("recorder", self._run, on_failure)
        self._began_ns: int | None = None  # to write; None: nothing is being written
        self._reported_lost = 0  # records of which the log says that they are lost
        self._warned: set[str] = set()

    def start(self) -> None:
        self._worker.start()

    @property
    def dropped(self) -> int:
        """Records that found the queue full."""
        return self._queue.dropped

    @property
    def failure(self) -> BaseException | None:
        """Why recording ended early, None while all is well."""
        return self._worker.failure

    def troubles(self) -> list[str]:
        """What its owner has to know now, a sentence each; of any thread, and without waiting."""
        began_ns, found = self._began_ns, []
        if began_ns is not None and self._clock.now_ns() - began_ns > HANGS_NS:
            found.append("the disk of the log does not respond: records may be lost")
        if self.dropped:
            found.append(LOST)
        if self._log.viewers_failure:
            found.append(self._log.viewers_failure)
        return found

    def poll(self) -> None:
        """Warn, once each, of what is wrong with the log or its viewers."""
        for trouble in self.troubles():
            if trouble not in self._warned:
                self._warned.add(trouble)
                self.note("warning", trouble)

    @property
    def size_bytes(self) -> int:
        """Of the log so far."""
        return self._log.size_bytes

    def keep(self, item: Record) -> None:
        """Queue one record; a frame's pixels are let go at once, but for the few viewers get."""
        if self.failure is None:
            self._queue.put_all(_kept(self._log, item))

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Queue the fates of a batch of datagrams."""
        if self.failure is None:
            self._queue.put_all(packets)

    def close(self, timeout_s: float = 10.0) -> None:
        """Write what is queued and finish the file; may be called twice."""
        if self._worker.alive:
            self._worker.stop(timeout_s)
        self._log.close()  # done by the thread already, unless it never ran

    def _run(self, stop: threading.Event) -> None:
        try:
            next_flush_ns = next_check_ns = self._clock.now_ns()
            while not stop.wait(POLL_S):
                self._began_ns = now_ns = self._clock.now_ns()
                self._write_queued()
                if now_ns >= next_flush_ns:
                    self._log.flush()
                    next_flush_ns = now_ns + FLUSH_NS
                if now_ns >= next_check_ns:
                    self._log.check_space()
                    next_check_ns = now_ns + SPACE_CHECK_NS
                self._began_ns = None
            self._write_queued()
            self._log.flush()
        finally:
            self._log.close()

    def _write_queued(self) -> None:
        packets: list[PacketRecord] = []
        slice_end = time.perf_counter() + SLICE_S
        items, taken_ns, dropped = self._queue.take_all(), self._clock.now_ns(), self.dropped
        for item in items:
            if isinstance(item, PacketRecord):
                packets.append(item)
                continue
            self._log.write(item, self._clock.now_ns())
            if time.perf_counter() > slice_end:
                time.sleep(PAUSE_S)
                slice_end = time.perf_counter() + SLICE_S
        if packets:
            self._log.write(PacketBatch.of(packets), self._clock.now_ns())
        if dropped > self._reported_lost:
            lost = RecordsLost(self._log.newest_ns, taken_ns, dropped - self._reported_lost)
            self._reported_lost = dropped
            self._log.write(lost, taken_ns)


class DirectRecorder(Journal):
    """Writes a session log at once, in the thread that records: for virtual time.

    Keeps what a `Recorder` keeps, without thread, queue or loss.

    The same records at the same times make the same file, byte by byte. Not thread safe.
    """

    def __init__(self, log: McapLog, clock: Clock) -> None:
        super().__init__(clock)
        self._log = log
        self._packets: list[PacketRecord] = []
        self._next_batch_ns = clock.now_ns() + BATCH_NS
        self._next_check_ns = clock.now_ns() + SPACE_CHECK_NS

    def keep(self, item: Record) -> None:
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
            self._log.check_space()
        for one in _kept(self._log, item):
            self._log.write(one, now_ns)

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Write the fates of a batch of datagrams, together with others of the same time."""
        self._packets.extend(packets)

    def close(self) -> None:
        """Write what is left and finish the file; may be called twice."""
        self._write_packets()
        self._log.close()

    def _write_packets(self) -> None:
        if self._packets:
            packets, self._packets = self._packets, []
            self._log.write(PacketBatch.of(packets), self._clock.now_ns())


def _kept(log: McapLog, item: Record) -> list[Record]:
    """What a log keeps of a record: frames without their pixels, but for the few viewers get."""
    if isinstance(item, Frame):
        return [FrameCaptured(item.view, item.index, item.capture_ns)]
    if not isinstance(item, ShownFrame):
        return [item]
    shown = FrameShown(item.view, item.index, item.shown_ns, item.whole, item.received_ns)
    return [shown, item] if log.wants_pixels(item) else [shown]
