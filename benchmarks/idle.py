"""The machine by itself: how well a bare loop keeps time and how fast a bare socket answers.

Run as a module it measures in a fresh process and prints JSON.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np

from tams_app.runtime.clock import FixedRate, MonotonicClock
from tams_app.runtime.realtime import use_fifo

RATE_HZ = 120.0
SECONDS = 10.0
ECHOES = 2000


def measure_idle() -> dict[str, Any]:
    """Figures of the idle machine, from a process of its own."""
    command = [sys.executable, "-m", "benchmarks.idle"]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    return dict(json.loads(result.stdout))


def period_errors_ms(seconds: float) -> np.ndarray:
    """|period − 1/120 s| of a loop that does nothing else."""
    clock = MonotonicClock()
    rate = FixedRate(clock, RATE_HZ)
    started = []
    for _ in range(round(seconds * RATE_HZ)):
        rate.wait()
        started.append(clock.now_ns())
    return np.abs(np.diff(started) - rate.period_ns) / 1e6


def echo_times_ms(count: int) -> np.ndarray:
    """Round trips of 40 bytes to a thread that sends them back, over loopback TCP."""
    server = socket.create_server(("127.0.0.1", 0))

    def echo() -> None:
        connection, _ = server.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := connection.recv(64):
                connection.sendall(data)

    threading.Thread(target=echo, name="echo", daemon=True).start()
    times = []
    with server, socket.create_connection(server.getsockname()) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(count):
            start = time.perf_counter()
            client.sendall(bytes(40))
            client.recv(64)
            times.append((time.perf_counter() - start) * 1e3)
            time.sleep(0.001)
    return np.array(times)


def main() -> None:
    scheduler = use_fifo(50)
    errors, echoes = period_errors_ms(SECONDS), echo_times_ms(ECHOES)
    print(
        json.dumps(
            {
                "scheduler": scheduler,
                "period_error_p99_ms": float(np.percentile(errors, 99)),
                "period_error_p99_9_ms": float(np.percentile(errors, 99.9)),
                "late_fraction": float(np.mean(errors > 1.0)),
                "round_trip_p50_ms": float(np.percentile(echoes, 50)),
                "round_trip_p99_ms": float(np.percentile(echoes, 99)),
            }
        )
    )


if __name__ == "__main__":
    main()
