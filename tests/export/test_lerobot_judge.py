"""A dataset as `lerobot-doctor` judges it, which is installed apart, in build/."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.export.conftest import Export
from tests.export.sessions import moving_session

pytestmark = [pytest.mark.untimed, pytest.mark.verify, pytest.mark.timeout(1200)]

HOME = Path(__file__).parents[2] / "build/lerobot-doctor"


def test_lerobot_doctor_finds_no_fault_of_the_format(tmp_path: Path, export: Export) -> None:
    subprocess.run([sys.executable, "-m", "venv", HOME], check=True)
    install = [HOME / "bin/pip", "install", "--quiet", "lerobot-doctor==0.2.*"]
    subprocess.run(install, check=True)  # without a network this fails: nothing was judged
    sessions = [moving_session(tmp_path / name, 3.0) for name in ("one", "two")]
    assert export(*sessions, "--out", tmp_path / "out")[0] == 0
    doctor = [HOME / "bin/lerobot-doctor", tmp_path / "out", "--json"]
    judged = subprocess.run(doctor, check=False, capture_output=True, text=True)
    verdicts = {one["name"]: one["severity"] for one in json.loads(judged.stdout)["checks"]}
    assert "FAIL" not in verdicts.values(), judged.stdout
