"""Every example runs as its first lines say, and prints what it promises."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.waiting

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
LONGEST = 40  # lines


def run(folder, name, *arguments):
    """The example's output; any warning or error fails."""
    result = subprocess.run(
        [sys.executable, "-W", "error", "-m", f"examples.{name}", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=110,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_named_in_the_guide(name):
    assert len((ROOT / "examples" / f"{name}.py").read_text().splitlines()) < LONGEST
    assert f"examples.{name}" in (ROOT / "examples" / "README.md").read_text()


def test_the_arm_moves_from_home_to_the_ready_pose_and_up(tmp_path):
    home, ready, higher = run(tmp_path, "drive_arm").splitlines()
    assert home.startswith("factory home")
    assert ready.endswith("[350.  -0. 180.] mm")
    height_mm = float(higher.split("[")[1].split("]")[0].split()[2])
    assert 225 < height_mm < 235


def test_the_strategies_are_shown_for_every_phase(tmp_path):
    lines = run(tmp_path, "own_strategy").splitlines()
    assert len(lines) == 2 * 6
    assert sum(line.startswith("primary") for line in lines) == 6


def test_the_network_delivers_loses_and_overflows(tmp_path):
    lines = run(tmp_path, "own_network").splitlines()
    counts = {line.split()[0]: int(line.split()[1]) for line in lines[:3]}
    assert sum(counts.values()) == 3000
    assert counts["delivered"] > counts["overflow"] > 0
    assert counts["lost"] > 0


@pytest.mark.verify
def test_a_session_is_opened_and_asked_for_its_state_until_its_time_is_over(tmp_path):
    *states, last = run(tmp_path, "live_session", "15").splitlines()
    assert any("disarmed" in state or "ready" in state for state in states)
    assert last.startswith("ended after 15 s; its log is in")


@pytest.mark.verify
def test_a_virtual_trial_leaves_a_log_that_pandas_reads(tmp_path):
    pytest.importorskip("pandas")
    told = run(tmp_path, "virtual_trial", "1.5")
    assert told.startswith("completed: False")
    assert "received SSIM 0." in told
    tables = run(tmp_path, "log_to_pandas", "logs/virtual-trial")
    assert "REACH" in tables
    assert all(f"\n{view} " in tables for view in ("eih", "gt", "gs"))
