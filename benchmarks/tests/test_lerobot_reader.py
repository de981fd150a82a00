"""The script for an environment of its own, which is started by its path."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.untimed

SCRIPT = PROJECT_DIRECTORY / "benchmarks" / "experiments" / "lerobot_reader.py"


def test_none_of_its_neighbours_stands_in_for_a_module_of_python() -> None:
    done = subprocess.run(
        [sys.executable, SCRIPT.name, "--help"], cwd=SCRIPT.parent, capture_output=True, text=True
    )
    last = (done.stderr.splitlines() or [""])[-1]
    missing = [f"ModuleNotFoundError: No module named '{name}'" for name in ("torch", "lerobot")]
    assert (done.returncode == 0 and "DATASET" in done.stdout.upper()) or last in missing
