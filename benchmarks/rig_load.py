"""CPU of the simulated rig's processes: `python -m benchmarks.rig_load`, prints JSON.

A client on the wire moves the arm as a session does: 120 velocities a second, the reports read. It
knows the two processes by their command lines and the protocol only, so with `--checkout FOLDER` it
measures another version of TAMS: that folder is what they are started in.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
RENDERERS = ("hw.sim.world.renderer", "hw.sim.renderer")  # the second one before the folders
READY_DEG = [0, 36.81, 86.74, 0, 49.93, 0]
RATE_HZ = 120.0
FPS = 5  # low, so that no frame is left out on a slow machine
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_ENABLE, _STATE, _MODE, _TCP_OFFSET, _VELOCITY = 11, 12, 19, 35, 82
_INVALID, _REFUSED = 0x08, 0x58  # of the status: not understood; or not ready, or an error


class Helper:
    """A helper process of the checkout: ready once constructed."""

    def __init__(self, checkout: Path, module: str, specification: dict[str, Any]) -> None:
        python = checkout / ".venv" / "bin" / "python"
        command = [str(python) if python.exists() else sys.executable, "-m", module]
        self._process = subprocess.Popen(
            [*command, json.dumps(specification)],
            cwd=checkout,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._process.stdout is not None
        self.facts = dict(json.loads(self._process.stdout.readline()))

    def cpu_s(self) -> float:
        """Processor time so far, of all threads."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) * TICK_S

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10)


class Client:
    """Enables the arm and moves it to and fro, in mode 5, until it is closed."""

    def __init__(self, facts: dict[str, Any]) -> None:
        self._control = socket.create_connection(("127.0.0.1", facts["control_port"]))
        self._control.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._reports = [
            socket.create_connection(("127.0.0.1", facts["report_port"] + place))
            for place in (0, 2)  # five and a hundred a second
        ]
        self._stop = threading.Event()
        for register, payload in (
            (_ENABLE, bytes([8, 1])),
            (_TCP_OFFSET, struct.pack("<6f", 0, 0, 82, 0, 0, 0)),
            (_MODE, bytes([5])),
            (_STATE, bytes([0])),
        ):
            self._request(register, payload)
        self._threads = [threading.Thread(target=self._move)]
        self._threads += [
            threading.Thread(target=self._read, args=(report,)) for report in self._reports
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for connection in (self._control, *self._reports):
            connection.close()

    def _request(self, register: int, payload: bytes) -> None:
        head = struct.pack(">HHHB", 1, 2, len(payload) + 1, register)
        self._control.sendall(head + payload)
        status = self._control.recv(256)[7]
        if status & (_REFUSED if register == _VELOCITY else _INVALID):
            raise SystemExit(f"the controller refused register {register}: {status:#x}")

    def _move(self) -> None:
        start = due = time.monotonic()
        while not self._stop.is_set():
            phase = 2 * math.pi * (due - start) / 2.0
            velocity = (40 * math.cos(phase), 60 * math.sin(phase), 30 * math.sin(2 * phase))
            twist = struct.pack("<6f", *velocity, 0, 0, 0.3 * math.cos(phase))
            self._request(_VELOCITY, twist + bytes(1) + struct.pack("<f", 0.1))
            due += 1 / RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))

    def _read(self, report: socket.socket) -> None:
        while not self._stop.is_set():
            report.recv(4096)


@contextlib.contextmanager
def running(checkout: Path, renderer: str | None) -> Iterator[list[Helper]]:
    """Rig, moved by a client, and renderer."""
    name = f"tams-bench-{os.getpid()}"
    rig = Helper(checkout, "hw.sim.rig", {
        "memory_name": name, "seed": 4, "host": "127.0.0.1", "control_port": 0, "report_port": 0,
        "start_joints_deg": READY_DEG,
    })  # fmt: skip
    client, helpers = Client(rig.facts), [rig]
    try:
        if renderer is not None:
            helpers.append(Helper(checkout, renderer, {
                "memory_name": name, "seed": 4, "fps": FPS, "nice": 0, "noise_sigma": 1.5,
            }))  # fmt: skip
        yield helpers
    finally:
        client.close()
        for helper in reversed(helpers):
            helper.close()


def measure(checkout: Path, seconds: float) -> dict[str, float]:
    """Share of a core that the rig takes; CPU of a set of three frames [ms]."""
    renderer = next(
        module
        for module in RENDERERS
        if (checkout / Path(*module.split(".")).with_suffix(".py")).exists()
    )
    with running(checkout, renderer) as helpers:
        time.sleep(2.0)  # the renderer's first frames
        before, start = [helper.cpu_s() for helper in helpers], time.monotonic()
        time.sleep(seconds)
        took = time.monotonic() - start
        rig, frames = (
            (helper.cpu_s() - cpu) / took for helper, cpu in zip(helpers, before, strict=True)
        )
    return {"rig_share_of_a_core": rig, "set_of_frames_ms": 1e3 * frames / FPS}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkout", type=Path, default=HERE)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    print(json.dumps(measure(options.checkout.resolve(), options.seconds)))


if __name__ == "__main__":
    main()
