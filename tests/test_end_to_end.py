"""A whole session as a user starts it."""

import json
import subprocess
import sys
from itertools import pairwise

import pytest

from tams_app.config import load_config
from tams_app.recording import read_log
from tams_app.records import Phase
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.summary.quality import SSIM_KINDS
from tests.real_time import require_real_time
from tests.spoken import spoken

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.timeout(180),
]


def command(out, *options):
    words = ["run_tams.py", "run", "--sim", "--headless", "--network", "s2", "--out", str(out)]
    return [sys.executable, *words, *options]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder and the words of one session on s2 that ran to its end."""
    require_real_time()
    out = tmp_path_factory.mktemp("run")
    options = ("--seed", "1", "--seconds", "90", "--operator", "scripted")
    words, errors = out.with_suffix(".out"), out.with_suffix(".err")
    with words.open("w") as stdout, errors.open("w") as stderr:
        done = subprocess.run(
            command(out, *options),
            cwd=PROJECT_DIRECTORY,
            stdout=stdout,
            stderr=stderr,
            timeout=170,
            check=False,
        )
    assert done.returncode == 0, errors.read_text()
    (folder,) = out.iterdir()
    return folder, words.read_text()


@pytest.fixture(scope="module")
def log(finished):
    return read_log(finished[0] / "session.mcap")


@pytest.fixture(scope="module")
def summary(finished):
    return json.loads((finished[0] / "summary.json").read_text())


def test_a_session_leaves_log_configuration_summary_and_frame(finished):
    folder, words = finished
    names = {path.name for path in folder.iterdir()}
    files = {"session.mcap", "config.yaml", "summary.json", "report.html", "bitrates.png"}
    assert names == files | {"helpers"}
    assert load_config(folder / "config.yaml").seed == 1
    assert (folder / "bitrates.png").read_bytes().startswith(b"\x89PNG")
    assert folder.name in words.replace("\n", "")


def test_the_block_is_placed_and_the_verdict_is_in_the_summary(summary, log):
    outcome = summary["outcome"]
    assert outcome["completed"] is True
    assert outcome["reason"] == "placed"
    engaged_ns = next(t.started_ns for t in log.ticks if t.arming == "engaged")
    opened_ns = [
        after.started_ns
        for before, after in pairwise(t for t in log.ticks if t.arm is not None)
        if before.arm.gripper_closed and after.arm.gripper_closed is False
    ][-1]
    # the judge looks 30 times a second
    assert outcome["completion_time_s"] == pytest.approx((opened_ns - engaged_ns) / 1e9, abs=0.3)


def test_the_task_passes_through_all_six_phases(summary, log):
    seen = [change.phase for change in log.phases]
    assert seen[0] is Phase.REACH
    assert set(seen) == set(Phase)
    assert seen.index(Phase.GRASP) < seen.index(Phase.TRANSPORT) < seen.index(Phase.RELEASE)


def test_the_frames_were_compared_with_what_was_captured(summary, log):
    captured = {(frame.view, frame.index) for frame in log.captured}
    told = [(one.view, one.index) for one in log.quality]
    assert len(set(told)) == len(told)
    assert len(set(told) & captured) > 0.9 * len(captured)  # the helper starts before the cameras
    for entry in summary["views"].values():
        for kind in SSIM_KINDS:
            assert 0.3 < entry[kind] < 1
            assert entry["ssim_n"][kind] > 0
        assert 0 < entry["ssim_sampled_fraction"] <= 1
    assert 0.3 < summary["primary_view"]["received_ssim"] < 1
    assert summary["primary_view"]["by_phase"]["REACH"]["live_ssim"] is not None


def test_report_makes_summary_and_frame_anew_from_the_log(finished, summary):
    folder, _ = finished
    for name in ("summary.json", "bitrates.png"):
        (folder / name).unlink()
    result = subprocess.run(
        [sys.executable, "run_tams.py", "report", str(folder)],
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert (folder / "bitrates.png").exists()


@pytest.mark.verify
def test_an_operator_who_sees_places_the_block_and_says_how_often_they_looked(tmp_path):
    require_real_time()
    out = tmp_path / "out"
    options = ("--seed", "4", "--seconds", "120", "--operator", "seeing")
    result = subprocess.run(
        command(out, *options),
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    told = [spoken(line) for line in result.stdout.splitlines()]
    assert "simulated operator: seeing (uses only the received images)" in told
    (folder,) = out.iterdir()
    told = json.loads((folder / "summary.json").read_text())
    assert told["outcome"]["completed"] is True
    assert told["operator"]["kind"] == "seeing"
    assert told["operator"]["glances_per_s"] > 4
    assert told["operator"]["relied_on"]["agreement"] is not None
