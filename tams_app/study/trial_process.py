"""Trials in processes of their own, side by side: a crash of one leaves the others alone, and each
begins from the same state. As `python -m` it is the child's side.

They run on this machine, or on the workers of an existing Dask cluster, which need TAMS installed
in the same version, and no shared file system: what a trial leaves comes back as an archive.
"""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from tams_app.errors import LogError, SetupError, TamsError, require_extra
from tams_app.study.plan import PlannedTrial
from tams_app.study.runner import MACHINE_NAME, SUMMARY_NAME, TrialRunner, mark_ended

LOG_NAME = "trial.log"
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
# Trials run side by side, one per core; and the last bits of a sum depend on who adds up what.
_ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_END_TIMEOUT_S = 5.0
_POLL_S = 0.05
CONNECT_TIMEOUT_S = 20.0
_LOST = "the cluster lost it"


@dataclass(frozen=True, slots=True)
class Job:
    """A trial, and the folder that is made for it."""

    trial: PlannedTrial
    folder: Path


class TrialProcess:
    """A running trial. `core`: the processor core it keeps to, None for any."""

    def __init__(self, runner: TrialRunner, job: Job, core: int | None = None) -> None:
        self.job = job
        path = os.pathsep.join(filter(None, sys.path))
        environment = {**os.environ, **_ONE_CORE, "PYTHONPATH": path}
        try:
            with (job.folder / LOG_NAME).open("ab") as log:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "tams_app.study.trial_process"],
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=log,
                    env=environment,
                    start_new_session=True,  # Ctrl-C is the parent's to handle
                )
        except OSError as error:
            raise TamsError(f"a trial could not be started: {error.strerror}") from error
        self._hand_over(pickle.dumps((runner, job, core, os.getpid())))

    def poll(self) -> str | None:
        """None while it runs; then why it failed, empty if it did not."""
        code = self._process.poll()
        return None if code is None else self._failure(code)

    def wait(self) -> str:
        """Wait for its end; why it failed, empty if it did not."""
        return self._failure(self._process.wait())

    def stop(self) -> None:
        """End it, by force if need be; may be called twice."""
        self._process.terminate()
        try:
            self._process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _hand_over(self, task: bytes) -> None:
        stdin = self._process.stdin
        assert stdin is not None
        try:
            with stdin:
                stdin.write(task)
        except BrokenPipeError:
            self._process.wait()  # it ended at once; its log says why

    def _failure(self, code: int) -> str:
        if code == 0:
            return ""
        if code < 0:
            return f"its process was ended by {signal.Signals(-code).name}"
        try:
            lines = (self.job.folder / LOG_NAME).read_text("utf-8", "replace").split("\n")
        except OSError:
            lines = []
        printed = [line.strip() for line in lines if line.strip()]
        return printed[-1] if printed else f"its process ended with exit code {code}"


class LocalPool:
    """Processes on this machine; `workers` None: one for each core that we may use.

    `slots`: the number of trials at a time, at least 1.
    """

    def __init__(self, runner: TrialRunner, workers: int | None = None) -> None:
        cores = sorted(os.sched_getaffinity(0))
        self.slots = workers or len(cores)
        self._runner = runner
        pinned = self.slots <= len(cores)  # more than cores: the system shares them out
        self._free: list[int | None] = list(cores) if pinned else [None] * self.slots
        self._running: dict[TrialProcess, int | None] = {}

    def start(self, job: Job) -> None:
        """Begin a trial; at most `slots` run at a time."""
        core = self._free.pop(0)
        self._running[TrialProcess(self._runner, job, core)] = core

    def wait(self) -> list[tuple[Job, str]]:
        """Wait for at least one to end: what ended, and why it failed ("" if it did not)."""
        while self._running:
            ended = [(one, failure) for one in self._running if (failure := one.poll()) is not None]
            if ended:
                for process, _ in ended:
                    self._free.append(self._running.pop(process))
                return [(process.job, failure) for process, failure in ended]
            time.sleep(_POLL_S)
        return []

    def close(self) -> None:
        """End those that still run; may be called twice."""
        for process in self._running:
            process.stop()
        self._running.clear()


class DaskPool:
    """As `LocalPool`, on the cluster of the scheduler at `address`; SetupError without one."""

    def __init__(self, runner: TrialRunner, address: str) -> None:
        require_extra("dask", "--dask")
        distributed: Any = import_module("distributed")
        self._runner = runner
        self._wait: Any = distributed.wait
        try:
            self._client: Any = distributed.Client(
                address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise SetupError(f"--dask {address}: no scheduler answers there: {error}") from error
        self._running: dict[Any, Job] = {}

    @property
    def slots(self) -> int:
        """As many as the workers there are now have threads; each trial is a process there."""
        threads: dict[str, int] = self._client.nthreads()
        return max(1, sum(threads.values()))

    def start(self, job: Job) -> None:
        future = self._client.submit(
            run_and_pack, self._runner, job.trial, pure=False, key=f"tams-{job.folder.name}"
        )
        self._running[future] = job

    def wait(self) -> list[tuple[Job, str]]:
        if not self._running:
            return []
        with self._client.as_current():
            done = self._wait(list(self._running), return_when="FIRST_COMPLETED").done
        return [(self._running[future], self._take(future)) for future in done]

    def close(self) -> None:
        with suppress(OSError):  # the scheduler may be gone
            self._client.cancel(list(self._running), force=True)
        self._running.clear()
        self._client.close()

    def _take(self, future: Any) -> str:
        job = self._running.pop(future)
        if future.status != "finished":
            return f"{_LOST}: {future.exception()}"
        failure, archive = future.result()
        future.release()
        unpack(archive, job.folder)
        return str(failure)


def run_and_pack(runner: TrialRunner, trial: PlannedTrial) -> tuple[str, bytes]:
    """On a worker: run one trial in a process of its own; why it failed, and what it left."""
    with tempfile.TemporaryDirectory(prefix="tams-trial-") as directory:
        folder = Path(directory)
        try:
            failure = TrialProcess(runner, Job(trial, folder)).wait()
        except TamsError as error:
            failure = str(error)
        return failure, pack(folder)


def pack(folder: Path) -> bytes:
    """Everything in `folder` as a tar archive, machine.json last: where it is, all is."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))
    names.sort(key=lambda name: name == MACHINE_NAME)
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for name in names:
            archive.add(folder / name, name, recursive=False)
    return buffer.getvalue()


def unpack(archive: bytes, folder: Path) -> None:
    """Put what a worker left into `folder`, in the order in which it was packed."""
    try:
        with tarfile.open(fileobj=io.BytesIO(archive)) as contents:
            contents.extractall(folder, filter="data")
    except OSError as error:
        raise LogError(f"{folder}: a trial cannot be put there: {error.strerror}") from error


def _main() -> int:
    runner, job, core, parent = pickle.load(sys.stdin.buffer)
    _end_with(parent)
    if core is not None:
        os.sched_setaffinity(0, {core})
    try:
        runner.run(job.trial, job.folder)
    except TamsError as error:
        print(error, file=sys.stderr)  # noqa: T201  the log of this process
        return 1
    except Exception:  # noqa: BLE001  the parent is notified by the log and the exit code
        traceback.print_exc()
        return 1
    if not (job.folder / SUMMARY_NAME).is_file():
        print(f"it left no {SUMMARY_NAME}", file=sys.stderr)  # noqa: T201
        return 1
    mark_ended(job.folder)
    return 0


def _end_with(parent: int) -> None:
    """Do not outlive a killed study."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before
        os._exit(1)


if __name__ == "__main__":
    sys.exit(_main())
