"""Sessions and trials of any checkout of this repository since commit 9ef7703, and what they cost.

They run with this interpreter and its packages, on the checkout's own code.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks import named_threads
from benchmarks.processor_time import CONTROL, Profile, watch
from tams_app.recording import SessionLog, read_log
from tams_app.teleop.safety import ArmingState

_OPTIONS = """
import inspect
from tams_app.cli import run
print(*inspect.signature(run).parameters)
"""
_END_TIMEOUT_S = 20.0
_ERROR_LINES = 3

Measures = dict[str, float | None]


@dataclass(frozen=True, slots=True)
class Setting:
    """What both sides of a pair run; `seconds`: of a session or a trial, at most."""

    seed: int
    fps: int
    seconds: float
    network: str = "s2"


@dataclass(frozen=True, slots=True)
class Checkout:
    """A working copy; `options`: what its `run` takes, so that both sides do the same work.

    A rate that adapts is none that both hold, and an operator who sees does other work than one
    who is told where things are, the only one there was.

    `settings`: a configuration file for its runs alone, laid over the default one.
    """

    directory: Path
    commit: str
    options: frozenset[str]
    settings: Path | None = None

    @classmethod
    def at(cls, directory: Path, settings: Path | None = None) -> Checkout:
        """The checkout in `directory`; RuntimeError if TAMS does not start there."""
        directory = directory.resolve()
        if not (directory / "run_tams.py").is_file():
            raise RuntimeError(f"{directory}: no checkout of TAMS")
        if settings is not None and not settings.is_file():
            raise RuntimeError(f"{settings}: no such file")
        options = frozenset(_output([sys.executable, "-c", _OPTIONS], directory).split())
        return cls(directory, _commit(directory), options, settings and settings.resolve())

    def configuration(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """The checkout's default configuration with its own settings and `changes`, by section."""
        files = [self.directory / "config" / "tams.yaml", *filter(None, [self.settings])]
        return {"version": 1, "include": [str(file) for file in files], **changes}


@dataclass(frozen=True, slots=True)
class SessionCost:
    """What a live session used while its control loop ran, and what it did meanwhile."""

    profile: Profile
    measures: Measures


def run_session(checkout: Checkout, setting: Setting) -> SessionCost:
    """A live session without windows; RuntimeError with its words if it fails."""
    with tempfile.TemporaryDirectory(prefix="tams-session-") as name:
        folder = Path(name)
        command = ["run", "--sim", "--headless", "--network", setting.network]
        command += ["--seed", str(setting.seed), "--seconds", f"{setting.seconds:g}"]
        if "fps" in checkout.options:
            command += ["--fps", str(setting.fps)]
        if "operator" in checkout.options:
            command += ["--operator", "scripted"]
        config = _write(folder, checkout.configuration({"video": {"fps": setting.fps}}))
        command += ["--config", str(config), "--out", str(folder / "logs")]
        launched = [sys.executable, named_threads.__file__, "run_tams.py", *command]
        with _process(launched, checkout.directory, folder) as process:
            samples = watch(process)
        _check(process, folder)
        profile = Profile.of(samples)
        (log,) = (folder / "logs").glob("*/session.mcap")
        summary = json.loads(log.with_name("summary.json").read_text(encoding="utf-8"))
        return SessionCost(profile, session_measures(profile, read_log(log), summary))


def run_trial(checkout: Checkout, setting: Setting) -> Measures:
    """A study of one trial in virtual time, its start and its summary included; RuntimeError."""
    with tempfile.TemporaryDirectory(prefix="tams-trial-") as name:
        folder = Path(name)
        study = {
            "strategies": ["tams"],
            "reference": "tams",
            "networks": [setting.network],
            "repetitions": 1,
        }
        limits = {"seed": setting.seed, "seconds": setting.seconds}
        config = _write(folder, checkout.configuration({"study": study, **limits}))
        command = [sys.executable, "run_tams.py", "study", "run", "--sim", "--participants", "1"]
        command += ["--workers", "1", "--config", str(config), "--out", str(folder / "study")]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with _process(command, checkout.directory, folder) as process:
            process.wait()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        _check(process, folder)
        summaries = list((folder / "study").rglob("summary.json"))
        if len(summaries) != 1:
            raise RuntimeError(f"{len(summaries)} trials ran, not one: {_said(folder)}")
        summary = json.loads(summaries[0].read_text(encoding="utf-8"))
        used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        virtual_s = float(summary["duration_s"])
        return {"virtual_cpu_s_per_s": used_s / virtual_s, "virtual_s": virtual_s}


def session_measures(profile: Profile, log: SessionLog, summary: Mapping[str, Any]) -> Measures:
    """The figures of a session; shares are of one core."""
    during = range(profile.start_ns, profile.end_ns)
    arming = [tick.arming for tick in log.ticks if tick.started_ns in during]
    ticks = len(arming)
    frames = sum(frame.capture_ns in during for frame in log.captured)
    if not ticks or not frames:
        raise RuntimeError(f"{ticks} ticks and {frames} frames while the control loop ran")
    if not profile.helpers.keys() >= {"rig", "renderer"}:
        raise RuntimeError(f"no rig or no renderer among {', '.join(sorted(profile.helpers))}")
    seconds, views = profile.seconds, len(log.header.views)
    beyond_s = profile.application_s - profile.encoding_s - profile.decoding_s
    latencies = [view["latency_ms"]["p50"] for view in summary["views"].values()]
    operator_s = profile.helpers.get("operator", 0.0)
    return {
        "beyond_share": beyond_s / seconds,
        "beyond_ms_per_frame": 1e3 * beyond_s / frames,
        "beyond_with_operator_share": (beyond_s + operator_s) / seconds,
        "control_ms_per_tick": 1e3 * profile.threads[CONTROL] / ticks,
        "rig_share": profile.helpers["rig"] / seconds,
        "set_ms": 1e3 * views * profile.helpers["renderer"] / frames,
        "encoding_ms_per_frame": 1e3 * profile.encoding_s / frames,
        "decoding_ms_per_frame": 1e3 * profile.decoding_s / frames,
        "session_share": (profile.application_s + sum(profile.helpers.values())) / seconds,
        "fps_given": frames / views / seconds,
        "engaged_share": arming.count(ArmingState.ENGAGED.value) / ticks,
        "late_share": summary["control"]["late_fraction"],
        "latency_p50_ms": max((value for value in latencies if value is not None), default=None),
        "others_share": profile.others_s / seconds,
    }


@contextlib.contextmanager
def _process(
    command: list[str], directory: Path, folder: Path
) -> Iterator[subprocess.Popen[bytes]]:
    """A command of a checkout, which is ended with what it has started when we are."""
    with (folder / "output").open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=directory,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # Ctrl-C is ours to handle
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _check(process: subprocess.Popen[bytes], folder: Path) -> None:
    if process.returncode:
        raise RuntimeError(f"exit code {process.returncode}: {_said(folder)}")


def _said(folder: Path) -> str:
    lines = (folder / "output").read_text(encoding="utf-8", errors="replace").splitlines()
    return " / ".join([line.strip() for line in lines if line.strip()][-_ERROR_LINES:])


def _write(folder: Path, content: Mapping[str, Any]) -> Path:
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
    return path


def _commit(directory: Path) -> str:
    """The commit's short name and whether files differ from it; of a copy without git, its path."""
    try:
        commit = _output(["git", "rev-parse", "--short", "HEAD"], directory).strip()
        changed = _output(["git", "status", "--porcelain", "--untracked-files=no"], directory)
    except RuntimeError:
        return str(directory)
    return f"{commit} with changes" if changed.strip() else commit


def _output(command: list[str], directory: Path) -> str:
    """What a command of the checkout prints; RuntimeError with its last words if it fails."""
    done = subprocess.run(
        command, cwd=directory, env=_environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(f"{directory}: {said[-1] if said else f'exit code {done.returncode}'}")
    return done.stdout


def _environment() -> dict[str, str]:
    """Ours, without paths to packages of this checkout."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
