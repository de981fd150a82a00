"""Processor time of a running session, read from outside: by thread, and by helper process."""

from __future__ import annotations

import contextlib
import re
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

INTERVAL_S = 0.5
MAIN = "main"
CONTROL = "control"
# The streaming threads of the appsrc before x264 and of the jitter buffer before the decoder. With
# them count colour conversion, packets, sockets and the Python that they call once a frame.
ENCODING = ("frames:src", "pictures:src")
DECODING = ("jitterbuffer:sr",)  # as the kernel cuts it

_OF_A_VIEW = re.compile(r"^(capture)-.*")
_IDLE = ("idle", "iowait", "guest", "guest_nice")  # a guest's time is in user and nice, too


@dataclass(frozen=True, slots=True)
class Sample:
    """Processor seconds used up to one moment; of `threads` by kernel id, with their names."""

    t_ns: int
    application_s: float
    threads: dict[int, tuple[str, float]]
    helpers: dict[str, float]
    machine_s: float  # all programs on all cores, and what other machines on the host took

    @property
    def running(self) -> bool:
        """Whether the control loop was, which is the session without its start and end."""
        return any(name == CONTROL for name, _ in self.threads.values())


@dataclass(frozen=True, slots=True)
class Profile:
    """Processor seconds used between two moments."""

    start_ns: int
    end_ns: int
    application_s: float
    threads: dict[str, float]
    helpers: dict[str, float]
    others_s: float  # of the machine's other programs

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def encoding_s(self) -> float:
        return sum(self.threads.get(name, 0.0) for name in ENCODING)

    @property
    def decoding_s(self) -> float:
        return sum(self.threads.get(name, 0.0) for name in DECODING)

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Profile:
        """From the first to the last sample of the running session; RuntimeError without video.

        Of a thread or helper that ended in between, what it used up to its last sample.
        """
        running = [sample for sample in samples if sample.running]
        if len(running) < 2:
            raise RuntimeError("the control loop did not run")
        first, last = running[0], running[-1]
        last_threads: dict[int, tuple[str, float]] = {}
        last_helpers: dict[str, float] = {}
        for sample in running:
            last_threads.update(sample.threads)
            last_helpers.update(sample.helpers)
        threads: dict[str, float] = {}
        for thread_id, (name, used_s) in last_threads.items():
            before_s = first.threads.get(thread_id, (name, 0.0))[1]
            threads[name] = threads.get(name, 0.0) + used_s - before_s
        helpers = {
            name: used_s - first.helpers.get(name, 0.0) for name, used_s in last_helpers.items()
        }
        application_s = last.application_s - first.application_s
        machine_s = last.machine_s - first.machine_s
        profile = cls(
            first.t_ns,
            last.t_ns,
            application_s,
            threads,
            helpers,
            max(0.0, machine_s - application_s - sum(helpers.values())),
        )
        if not profile.encoding_s or not profile.decoding_s:
            known = ", ".join(sorted(threads))
            raise RuntimeError(f"no thread that encodes or none that decodes among {known}")
        return profile


def watch(process: subprocess.Popen[bytes], interval_s: float = INTERVAL_S) -> list[Sample]:
    """Samples of a session until it has ended."""
    session, samples = psutil.Process(process.pid), []
    while process.poll() is None:
        with contextlib.suppress(psutil.NoSuchProcess, FileNotFoundError, ProcessLookupError):
            samples.append(take_sample(session))
        time.sleep(interval_s)
    return samples


def take_sample(session: psutil.Process) -> Sample:
    """What a session has used by now."""
    application = session.cpu_times()
    return Sample(
        time.monotonic_ns(),
        application.user + application.system,
        _threads(session.pid),
        _helpers(session),
        sum(used for name, used in psutil.cpu_times()._asdict().items() if name not in _IDLE),
    )


def _threads(pid: int) -> dict[int, tuple[str, float]]:
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            name = (task / "comm").read_text(encoding="utf-8").strip()
            times = (task / "schedstat").read_text(encoding="utf-8")
        except (FileNotFoundError, ProcessLookupError):  # it has just ended
            continue
        thread_id = int(task.name)
        found[thread_id] = (MAIN if thread_id == pid else group(name), thread_s(times))
    return found


def _helpers(session: psutil.Process) -> dict[str, float]:
    found: dict[str, float] = {}
    for child in session.children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            name, times = helper_name(child.cmdline()), child.cpu_times()
            found[name] = found.get(name, 0.0) + times.user + times.system
    return found


def thread_s(schedstat: str) -> float:
    """Seconds on a processor: the first number of /proc/PID/task/TID/schedstat, in nanoseconds.

    `stat` counts in steps of 10 ms, too coarse for the sum over many threads that do little.
    """
    return int(schedstat.split()[0]) / 1e9


def group(name: str) -> str:
    """The name under which a thread is counted: one for all views, one for all unnamed."""
    if name.startswith(("Thread-", "python")):
        return "unnamed"
    return _OF_A_VIEW.sub(r"\1", name)


def helper_name(command: Sequence[str]) -> str:
    """The word of `python -m MODULE` that names the process; else its program's name."""
    if "-m" not in command[:-1]:
        return Path(command[0]).name if command else "ended"
    module = command[command.index("-m") + 1]
    return module.removesuffix(".process").removesuffix("_process").split(".")[-1]
