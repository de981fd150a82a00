"""The session's side of the link relay: start, records, end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from tams_app.config import Network
from tams_app.records import PacketRecord
from tams_app.video.live.reporting_helper import ReportingHelper
from tams_app.video.live.udp import ViewPorts


class RelayClient:
    """One relay process between the video ends.

    `exits` say per view where the link's flows come out (what the ends have bound). A trace
    begins at `epoch_ns` of the machine's monotonic clock. `on_packets` and `on_failure` are called
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
        epoch_ns: int,
    ) -> None:
        self._specification = {
            "network": network.model_dump(mode="json"),
            "seed": seed,
            "epoch_ns": epoch_ns,
            "exits": {view: asdict(ports) for view, ports in exits.items()},
        }
        self._helper = ReportingHelper(
            "relay",
            "tams_app.video.live.relay",
            log_directory=log_directory,
            report_type=list[PacketRecord],
            on_report=on_packets,
            on_failure=on_failure,
            ended_unasked="the link relay ended unasked, so no video arrives; "
            "end this session and start anew",
        )

    def start(self) -> dict[str, ViewPorts]:
        """Start the relay; returns per view the entrances to send to. HelperError if it cannot."""
        ready = self._helper.start(self._specification)
        return {view: ViewPorts(**ports) for view, ports in ready["entrances"].items()}

    @property
    def pid(self) -> int | None:
        """The relay's process id; None before the start."""
        return self._helper.process.pid if self._helper.process else None

    def close(self) -> None:
        """End the relay and read what it still has to report; may be called twice."""
        self._helper.close()
