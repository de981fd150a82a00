"""Processor load and memory of the application and its helpers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import psutil

from tams_app.records import SystemSample
from tams_app.runtime.clock import Clock

INTERVAL_S = 1.0


class LoadMonitor:
    """Samples once a second; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        helpers: Mapping[str, int],
        record: Callable[[SystemSample], None],
    ) -> None:
        self._clock = clock
        self._app = psutil.Process()
        self._helpers = {name: psutil.Process(pid) for name, pid in helpers.items()}
        self._record = record

    def run(self, stop: threading.Event) -> None:
        self.sample()  # the first figures of cpu_percent are meaningless
        while not stop.wait(INTERVAL_S):
            self._record(self.sample())

    def sample(self) -> SystemSample:
        """Percent of one core since the last call, and resident memory now."""
        helper_cpu: dict[str, float] = {}
        rss = self._app.memory_info().rss
        for name, process in self._helpers.items():
            try:
                helper_cpu[name] = process.cpu_percent()
                rss += process.memory_info().rss
            except psutil.NoSuchProcess:
                helper_cpu[name] = 0.0  # it died; the session's watch deals with that
        return SystemSample(
            self._clock.now_ns(), self._app.cpu_percent(), helper_cpu, rss / 1_000_000
        )
