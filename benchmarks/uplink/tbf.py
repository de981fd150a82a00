"""The budget `feedback` over a bottleneck that is not ours: tbf between two network namespaces.

`python -m benchmarks.uplink.tbf` (as root) runs the senders and the policy loop of a session in one
namespace and its receivers in the other; three views of moving images go over real UDP. The budget
is not told of the bottleneck. tbf delays nothing but what waits, so the link has no latency of its
own. Bytes and capacity are those that the kernel counts, with Ethernet's headers; the queue is
each packet's time on its way beyond that of the fastest, as the receivers tell it.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks.uplink.tbf_ends import INTERFACE, RECEIVER_HOST, SENDER_HOST
from tams_app.errors import SetupError

QUEUE_MS = 150
_BURST_BYTES = 3100  # two packets; tbf wants more than one
_END_S = 5.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.uplink.tbf", description=__doc__)
    parser.add_argument("--kbps", type=float, default=3000.0, help="default 3000")
    parser.add_argument("--seconds", type=float, default=20.0, help="measured (default 20)")
    parser.add_argument("--startup-s", type=float, default=5.0, help="before (default 5)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that namespaces are removed
    found: dict[str, Any]
    try:
        found = run(options.kbps, options.startup_s, options.seconds)
    except SetupError as error:
        found = {"skipped": str(error)}
        print(f"skipped: {error}")
    else:
        queue = found["queue_ms"]
        print(
            f"feedback at {options.kbps:g} kbit/s: used {found['utilisation']:.1%}, dropped "
            f"{found['dropped_fraction']:.2%}, queue p50 {queue['p50']:.1f}, "
            f"p95 {queue['p95']:.1f}, max {queue['max']:.1f} ms"
        )
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def run(kbps: float, startup_s: float, seconds: float) -> dict[str, Any]:
    """One run; SetupError says what this machine lacks for it."""
    with namespaces(kbps) as (here, there), ExitStack() as stack:
        receivers = stack.enter_context(_end(there, end="receivers"))
        _line(receivers)
        sending = _end(here, end="senders", startup_s=startup_s, seconds=seconds)
        senders = stack.enter_context(sending)
        _line(senders)
        found = _line(senders)
    return {"utilisation": found["left_kbps"] / kbps, **found}


@contextmanager
def namespaces(kbps: float) -> Iterator[tuple[str, str]]:
    """Two of them, with the bottleneck on the way from the first to the second."""
    if sys.platform != "linux" or os.geteuid() != 0:
        raise SetupError("network namespaces need Linux and root")
    if not shutil.which("ip") or not shutil.which("tc"):
        raise SetupError("ip and tc are missing; apt-get install iproute2")
    here, there = f"tams-up{os.getpid()}", f"tams-down{os.getpid()}"
    with ExitStack() as stack:
        for name in (here, there):
            stack.callback(_ip, "netns", "del", name, must=False)
            _ip("netns", "add", name)
        _ip(*f"-n {here} link add {INTERFACE} type veth peer name vb netns {there}".split())
        for space, interface, host in (
            (here, INTERFACE, SENDER_HOST),
            (there, "vb", RECEIVER_HOST),
        ):
            _ip("-n", space, "addr", "add", f"{host}/24", "dev", interface)
            _ip("-n", space, "link", "set", interface, "up")
            _ip("-n", space, "link", "set", "lo", "up")
        shape = f"rate {kbps:g}kbit burst {_BURST_BYTES} latency {QUEUE_MS}ms"
        tbf = f"tc qdisc add dev {INTERFACE} root tbf {shape}"
        _ip("netns", "exec", here, *tbf.split())
        yield here, there


@contextmanager
def _end(space: str, **specification: Any) -> Iterator[subprocess.Popen[str]]:
    command = ["ip", "netns", "exec", space, sys.executable, "-m", "benchmarks.uplink.tbf_ends"]
    command.append(json.dumps(specification))
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            yield process
        finally:
            assert process.stdin is not None
            process.stdin.close()  # then it ends by itself
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _line(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise RuntimeError("an end of the link has failed")
    said: dict[str, Any] = json.loads(line)
    return said


def _ip(*words: str, must: bool = True) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, timeout=10, check=False)
    if must and done.returncode:
        raise SetupError(f"ip {' '.join(words)}: {done.stderr.strip()}")


if __name__ == "__main__":
    main()
