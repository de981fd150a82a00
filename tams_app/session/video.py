"""The video of one session as its other parts see it; `uplink` has it live, `virtual.video` not."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import OrderedDict
from typing import Protocol

from tams_app.config import Config, Network
from tams_app.policy.allocation import Policy
from tams_app.records import Frame, Phase, ShownFrame
from tams_app.session.recorders import SessionRecords
from tams_app.units import NS_PER_MS
from tams_app.video.networks import network_capacity
from tams_app.video.repair import RepairRule, repair_rule

_REMEMBERED = 300  # ten seconds of frames


class Quality(Protocol):
    """Compares the frames shown with those captured."""

    def captured(self, frame: Frame) -> None:
        """A camera's frame, in the order of capture."""

    def shown(self, shown: ShownFrame) -> None:
        """A frame that reached the screen, after the captures that came before it."""


class CaptureTimes:
    """When the last frames of one view were captured, by their index."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._times: OrderedDict[int, int] = OrderedDict()

    def add(self, index: int, capture_ns: int) -> None:
        with self._lock:
            self._times[index] = capture_ns
            if len(self._times) > _REMEMBERED:
                self._times.popitem(last=False)

    def of(self, index: int) -> int | None:
        """Capture time [ns] of frame `index`, None if it is not remembered."""
        with self._lock:
            return self._times.get(index)


class Video(ABC):
    """All views of one session, from the camera's frame to the operator's screen."""

    def __init__(
        self, config: Config, network: Network, epoch_ns: int, log: SessionRecords, quality: Quality
    ) -> None:
        """A capacity trace of `network` begins at `epoch_ns`."""
        video = config.video
        self.capacity = network_capacity(network, epoch_ns)
        self._rule = repair_rule(network, video.pli_min_interval_ms, video.repair)
        self.delay_ns = video_delay_ns(network, self._rule)
        first = Policy.of(config, self.capacity).step(epoch_ns, Phase.REACH, sent_bytes=0)
        self._start_kbps = first.target_kbps
        self._log = log
        self._quality = quality
        self._times = {view: CaptureTimes() for view in video.views}

    def push(self, frame: Frame) -> None:
        """Send a captured frame, and remember it; each view from one thread."""
        self._log.capture(frame)
        self._quality.captured(frame)
        self._times[frame.view].add(frame.index, frame.capture_ns)
        self._send(frame)

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the frame shown of `view`; None before the first, and where it is not known."""
        shown = self.shown(view)
        capture_ns = None if shown is None else self._times[view].of(shown.index)
        return None if capture_ns is None else now_ns - capture_ns

    @abstractmethod
    def shown(self, view: str) -> ShownFrame | None:
        """The newest frame of `view` on the operator's screen; None before the first."""

    @abstractmethod
    def set_targets(self, target_kbps: dict[str, int]) -> None:
        """The wire rate each view is to meet from now on."""

    @abstractmethod
    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far, all views together."""

    @abstractmethod
    def poll(self) -> str:
        """The first failure of any stream in one sentence, "" while all work."""

    @abstractmethod
    def close(self) -> None:
        """Stop everything that was started; may be called twice."""

    @abstractmethod
    def _send(self, frame: Frame) -> None: ...

    def _on_shown(self, shown: ShownFrame) -> None:
        self._log.record(shown)
        self._quality.shown(shown)


def video_delay_ns(network: Network, rule: RepairRule) -> int:
    """One-way latency plus jitter buffer: no frame is ever shown younger."""
    return round((network.latency_ms + rule.latency_ms) * NS_PER_MS)
