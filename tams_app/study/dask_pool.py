"""Trials on an existing Dask cluster. No shared file system is needed: what a trial leaves comes
back as an archive. The workers need TAMS installed in the same version."""

from __future__ import annotations

import io
import tarfile
import tempfile
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from tams_app.errors import LogError, SetupError, TamsError, require_extra
from tams_app.study.plan import PlannedTrial
from tams_app.study.runner import MACHINE_NAME, TrialRunner
from tams_app.study.trial_process import Job, TrialProcess

CONNECT_TIMEOUT_S = 20.0
_LOST = "the cluster lost it"


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
