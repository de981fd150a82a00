"""The feedback model and GStreamer's rtpsession begin alike on the same link with the same seed."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.untimed


def counts_of_a_fresh_process(kind: str, network: str, seed: int) -> dict[str, int]:
    command = [sys.executable, "-m", "benchmarks.experiments.feedback_model", "--seconds", "1"]
    command += ["--one", kind, network, str(seed)]
    done = subprocess.run(
        command, cwd=PROJECT_DIRECTORY, capture_output=True, text=True, check=True, timeout=100
    )
    counts: dict[str, int] = json.loads(done.stdout)
    return counts


def test_the_first_frame_meets_no_report_on_its_way() -> None:
    # a report ahead of it would lend it its jitter, and the jitter buffer would then wait as much
    # longer for every repair
    model, real = (
        counts_of_a_fresh_process(kind, "s3", seed=2) for kind in ("model", "rtpsession")
    )
    assert model["first_arrivals_us"] == real["first_arrivals_us"] > 0
    assert min(model["frames_shown"], real["frames_shown"]) > 60  # of three views' 90
