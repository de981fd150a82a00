"""The session's side of the link relay: starts it, reads its records, ends it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from tams_app.capacity import Capacity
from tams_app.config import Network
from tams_app.errors import HelperError
from tams_app.records import PacketRecord
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import READY_TIMEOUT_S, HelperProcess
from tams_app.runtime.worker import Worker
from tams_app.video.helper_stream import received
from tams_app.video.networks import network_capacity
from tams_app.video.ports import ViewPorts
from tams_app.video.relay_wire import BatchDecoder, RelayStatistics


class RelayClient:
    """One relay process between the video ends.

    `exits` say per view where the link's flows come out (what the ends have bound). A trace
    begins at `epoch_ns` of the machine's monotonic clock, by default now;
    `capacity` is the very bottleneck the relay emulates. `on_packets` and `on_failure` are called
    in the reading thread; a relay that ends unasked is a failure. Records name a packet's
    delivery when it is decided, up to the link's delay ahead of time.
    """

    def __init__(
        self,
        network: Network,
        exits: Mapping[str, ViewPorts],
        *,
        seed: int,
        log_directory: Path | None,
        on_packets: Callable[[list[PacketRecord]], None],
        on_failure: Callable[[str, BaseException], None],
        epoch_ns: int | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._network = network
        self._exits = dict(exits)
        self._seed = seed
        self._log_directory = log_directory
        self._on_packets = on_packets
        clock = clock or MonotonicClock()
        self.epoch_ns = clock.now_ns() if epoch_ns is None else epoch_ns
        self.capacity: Capacity = network_capacity(network, self.epoch_ns)
        self.statistics = RelayStatistics()
        self.scheduler = ""  # what the relay was granted
        self._process: HelperProcess | None = None
        self._connection: socket.socket | None = None
        self._reader = Worker("relay-records", self._read, on_failure)
        self._closing = False

    def start(self) -> dict[str, ViewPorts]:
        """Start the relay; returns per view the entrances to send to. HelperError if it cannot."""
        with socket.create_server(("127.0.0.1", 0), backlog=1) as listener:
            listener.settimeout(READY_TIMEOUT_S)
            specification = {
                "network": self._network.model_dump(mode="json"),
                "seed": self._seed,
                "epoch_ns": self.epoch_ns,
                "exits": {view: asdict(ports) for view, ports in self._exits.items()},
                "records_port": listener.getsockname()[1],
            }
            self._process = HelperProcess(
                "relay", "tams_app.video.relay", specification, self._log_directory
            )
            try:
                self._process.start()
                ready = self._process.wait_ready()
                self._connection, _ = listener.accept()
            except BaseException:
                self.close()
                raise
        self.scheduler = str(ready["scheduler"])
        self._reader.start()
        return {view: ViewPorts(**ports) for view, ports in ready["entrances"].items()}

    @property
    def pid(self) -> int | None:
        """The relay's process id; None before the start."""
        return self._process.pid if self._process else None

    def close(self) -> None:
        """End the relay and read what it still has to say; may be called twice."""
        self._closing = True
        if self._process is not None:
            self._process.stop()
        self._reader.request_stop()
        if self._connection is not None:
            self._reader.stop()
            self._connection.close()

    def _read(self, stop: threading.Event) -> None:
        assert self._connection is not None
        decoder = BatchDecoder(tuple(self._exits))
        for data in received(self._connection, stop):
            for records, self.statistics in decoder.feed(data):
                if records:
                    self._on_packets(records)
        if not self._closing:
            raise HelperError(
                "the link relay ended unasked, so no video arrives; end this session and start anew"
            )
