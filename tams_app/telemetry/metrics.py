"""Figures of a running session over HTTP, in Prometheus' text format.

https://prometheus.io/docs/instrumenting/exposition_formats/
"""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from http.server import HTTPServer
from typing import Any

from prometheus_client import CollectorRegistry, MetricsHandler
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from tams_app.recording import Header
from tams_app.recording.topics import FrameCaptured, FrameShown
from tams_app.records import (
    LATE_NS,
    LINK_LOST,
    DroppedFrame,
    EncodedFrame,
    Note,
    Phase,
    PhaseChange,
    SessionState,
    StopRecord,
    SystemSample,
    Tick,
    ViewState,
)
from tams_app.runtime.clock import Clock
from tams_app.runtime.worker import Worker
from tams_app.telemetry.address import Address, bound
from tams_app.telemetry.pace import Pace
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

_STATE_HZ = 1.0
_POLL_S, _PATIENCE_S = 0.1, 1.0  # of a caller that sends or takes nothing

# name, what it is, value of a state (None: not known, and left out)
_OF_SESSION: tuple[tuple[str, str, Callable[[SessionState], float | None]], ...] = (
    ("tams_session_seconds", "Time since the session's start.", lambda s: s.t_s),
    (
        "tams_arm_state_age_seconds",
        "Age of what is known of the arm.",
        lambda s: None if s.heard_ns is None else (s.now_ns - s.heard_ns) / NS_PER_S,
    ),
    ("tams_deadman_pressed", "1 while the deadman is held.", lambda s: s.deadman),
    ("tams_gripper_closed", "1 if it was last commanded to close.", lambda s: s.gripper_closed),
    (
        "tams_budget_bits_per_second",
        "What the views share, of IP datagrams.",
        lambda s: _bits(s.budget_kbps),
    ),
    (
        "tams_estimated_capacity_bits_per_second",
        "What the uplink is believed to carry.",
        lambda s: _bits(s.estimate_kbps),
    ),
    (
        "tams_emulated_capacity_bits_per_second",
        "What the emulated network carries.",
        lambda s: _bits(s.capacity_kbps),
    ),
    (
        "tams_uplink_bits_per_second",
        "What all views have sent in the last second, with repair.",
        lambda s: _bits(s.link_kbps),
    ),
    (
        "tams_uplink_queue_seconds",
        "Longest wait at the bottleneck in the last second.",
        lambda s: _thousandth(s.queue_ms),
    ),
    (
        "tams_uplink_loss_ratio",
        "Share of the last second's datagrams that did not arrive.",
        lambda s: s.loss,
    ),
)
_OF_VIEW: tuple[tuple[str, str, Callable[[ViewState], float | None]], ...] = (
    (
        "tams_video_target_bits_per_second",
        "What the view is to send.",
        lambda v: _bits(v.target_kbps),
    ),
    (
        "tams_video_sent_bits_per_second",
        "What the view has sent in the last second.",
        lambda v: _bits(v.sent_kbps),
    ),
    (
        "tams_video_captured_frames_per_second",
        "Frames that the camera has given in the last second.",
        lambda v: v.given_fps,
    ),
    (
        "tams_video_shown_frames_per_second",
        "Frames that the operator got in the last second.",
        lambda v: v.shown_fps,
    ),
    (
        "tams_video_latency_seconds",
        "Of the newest frame shown, from its capture to the screen.",
        lambda v: _thousandth(v.latency_ms),
    ),
    (
        "tams_video_age_seconds",
        "Age of the newest frame shown that counts.",
        lambda v: _thousandth(v.age_ms),
    ),
    (
        "tams_video_live_ssim_ratio",
        "SSIM of what is on the screen with what the camera sees, 0 to 1.",
        lambda v: v.live_ssim,
    ),
    (
        "tams_video_task_live_ssim_ratio",
        "The same within the task's region.",
        lambda v: v.task_live_ssim,
    ),
)
_COUNTED = {  # what it counts, and the label's name
    "tams_control_ticks": ("Ticks of the control loop.", ""),
    "tams_control_late_ticks": (
        "Ticks that began more than 1 ms after they were due, and those left out.",
        "",
    ),
    "tams_stops": ("Stops that were not the operator's own release.", "reason"),
    "tams_phase_changes": ("Phases begun.", "phase"),
    "tams_video_captured_frames": ("Frames captured.", "view"),
    "tams_video_sent_frames": ("Frames encoded and sent.", "view"),
    "tams_video_dropped_frames": ("Frames left out at the source.", "view"),
    "tams_video_shown_frames": ("Frames shown.", "view"),
    "tams_notes": ("Sentences for the operator.", "level"),
}
_ARMING = (*(state.value for state in ArmingState), "starting", LINK_LOST)


class Metrics(Collector):
    """Counts what is recorded and keeps the newest state; satisfies `tams_app.recording.Viewers`.

    Requests are answered one at a time in a thread of its own. The recorder's thread counts, the
    main thread gives the state, and neither waits for it.
    """

    def __init__(self, address: Address, header: Header, clock: Clock) -> None:
        """Served at `address`; SetupError if it is not to be had."""
        self._clock, self._pace = clock, Pace(_STATE_HZ)
        self._about = {
            "version": header.version,
            "name": header.name,
            "strategy": header.strategy,
            "network": header.network,
            "budget": header.budget_mode,
        }
        self._state: SessionState | None = None
        self._load: SystemSample | None = None
        self._counts: Counter[tuple[str, str]] = Counter()
        self._skipped = 0
        registry = CollectorRegistry()
        registry.register(self)
        self._server = _Server(address, registry)
        self._worker = Worker("metrics", self._server.serve)
        self._worker.start()

    def refresh(self, state: Callable[[], SessionState]) -> None:
        """Take the session's state, once a second however often this is called."""
        if self._pace.is_due(self._clock.now_ns()):
            self._state = state()

    def receive(self, record: Any, now_ns: int) -> None:
        """Count a record, if it is one that counts."""
        match record:
            case Tick():
                self._count("tams_control_ticks")
                late = record.started_ns - record.due_ns > LATE_NS
                self._count("tams_control_late_ticks", "", late + record.skipped - self._skipped)
                self._skipped = record.skipped
            case FrameCaptured():
                self._count("tams_video_captured_frames", record.view)
            case EncodedFrame():
                self._count("tams_video_sent_frames", record.view)
            case FrameShown():
                self._count("tams_video_shown_frames", record.view)
            case DroppedFrame():
                self._count("tams_video_dropped_frames", record.view)
            case StopRecord():
                self._count("tams_stops", record.reason)
            case PhaseChange():
                self._count("tams_phase_changes", record.phase.value)
            case Note():
                self._count("tams_notes", record.level)
            case SystemSample():
                self._load = record

    def wants(self, view: str, shown_ns: int) -> bool:
        """Never: it has no pictures."""
        return False

    def close(self) -> None:
        """Answer no more, and free the address; may be called twice."""
        self._worker.stop()
        self._server.server_close()

    def collect(self) -> Iterator[Metric]:
        """Everything known now; called for each request."""
        yield InfoMetricFamily("tams_session", "What runs here.", self._about)
        state, load = self._state, self._load
        if state is not None:
            yield from _of_state(state)
        if load is not None:
            percent = load.app_cpu_percent + sum(load.helper_cpu_percent.values())
            yield _gauge(
                "tams_cpu_cores", "Processor cores in use, application and helpers.", percent / 100
            )
            yield _gauge(
                "tams_resident_memory_bytes",
                "Memory in use, application and helpers.",
                load.rss_mb * 1e6,
            )
        counts = self._counts.copy()
        for name, (what, label) in _COUNTED.items():
            family = CounterMetricFamily(name, what, labels=[label] if label else [])
            for (counted, value), count in counts.items():
                if counted == name:
                    family.add_metric([value] if label else [], count)
            yield family

    def _count(self, name: str, label: str = "", amount: int = 1) -> None:
        self._counts[name, label] += amount


class _Server(HTTPServer):
    """Answers one caller after the other, each within a second or not at all."""

    def __init__(self, address: Address, registry: CollectorRegistry) -> None:
        handler = MetricsHandler.factory(registry)
        handler.timeout = _PATIENCE_S  # type: ignore[attr-defined]
        super().__init__((address.host, address.port), handler, bind_and_activate=False)
        self.socket.close()
        self.socket = bound(address)
        self.server_activate()
        self.timeout = _POLL_S

    def serve(self, stop: threading.Event) -> None:
        while not stop.is_set():
            self.handle_request()

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), OSError):
            raise  # what it handles; of a caller who has left there is nothing to say


def _of_state(state: SessionState) -> Iterator[Metric]:
    arming = dict.fromkeys([*_ARMING, state.arming])  # also a word of another version's
    yield _one_of("tams_arming_state", "1 for the arming state.", "state", arming, state.arming)
    phases = [phase.value for phase in Phase]
    yield _one_of("tams_phase", "1 for the phase of the task.", "phase", phases, state.phase)
    yield _one_of(
        "tams_primary_view",
        "1 for the view that matters in the phase.",
        "view",
        state.views,
        state.primary_view,
    )
    for name, what, value_of in _OF_SESSION:
        yield _gauge(name, what, value_of(state))
    for name, what, of_view in _OF_VIEW:
        family = GaugeMetricFamily(name, what, labels=["view"])
        for view, shown in state.views.items():
            if (value := of_view(shown)) is not None:
                family.add_metric([view], value)
        yield family


def _one_of(name: str, what: str, label: str, words: Iterable[str], now: str) -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, what, labels=[label])
    for word in words:
        family.add_metric([word], word == now)
    return family


def _gauge(name: str, what: str, value: float | None) -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, what)
    if value is not None:
        family.add_metric([], value)
    return family


def _bits(kbps: float | None) -> float | None:
    return None if kbps is None else kbps * 1000


def _thousandth(milliseconds: float | None) -> float | None:
    return None if milliseconds is None else milliseconds / 1000
