"""What another distribution adds works like what TAMS brings, without a change to TAMS.

`installed/` holds an installed distribution with one entry point of each kind; each test runs in a
process that finds it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Phase
from tests.faces.window.xvfb import virtual_screen

pytestmark = [pytest.mark.waiting, pytest.mark.timeout(600)]

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CONFIG = HERE / "outside.yaml"


def python(*arguments: str | Path, environment: dict[str, str] | None = None) -> str:
    """What a Python with the other distribution prints."""
    paths = os.pathsep.join((str(HERE / "installed"), str(ROOT)))
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": paths} | (environment or {}),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def tams(*arguments: str | Path, environment: dict[str, str] | None = None) -> str:
    return python("run_tams.py", *arguments, environment=environment)


def test_a_session_has_hand_face_strategy_budget_inference_and_network_of_another_distribution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with virtual_screen(tmp_path, monkeypatch):
        tams(
            *("run", "--sim", "--config", CONFIG, "--hand", "outside", "--seconds", "6"),
            *("--out", tmp_path / "logs"),
        )
    (folder,) = (tmp_path / "logs").iterdir()
    log = read_log(folder / LOG_NAME)
    assert {one.capacity_kbps for one in log.allocations} == {3000.0}
    last = [one.target_kbps for one in log.allocations][-1]
    assert last["gs"] > 10 * last["eih"] > 0
    assert [change.phase for change in log.phases] == [Phase.REACH, Phase.TRANSPORT]
    assert (folder / "lamp.txt").read_text().splitlines()[-1] in ("disarmed", "starting")
    assert log.facts["hand"] == "outside"
    out = tmp_path / "count.txt"
    tams("export", folder, "--format", "outside", "--out", out, "--task", "nothing")
    assert out.read_text() == f"nothing: [{len(log.ticks)}]\n"


@pytest.mark.verify
def test_an_arm_of_another_distribution_works_in_virtual_time(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from tams_app.config import load_config; "
        "from tams_app.robot.build import check_ready_pose; "
        "from tams_app.session.virtual.runner import run_virtual_trial; "
        "from tams_app.study.plan import Participant, ParticipantState; "
        "from tests.session.virtual.runs import PARTICIPANT, WALL_NS; "
        "config = load_config(Path(sys.argv[1]), {'arm.model': 'outside', 'seconds': 3.0}); "
        "check_ready_pose(config); "
        "run_virtual_trial(config, PARTICIPANT, Path(sys.argv[2]), WALL_NS)"
    )
    python("-c", script, CONFIG, tmp_path)
    log = read_log(tmp_path / LOG_NAME)
    assert log.header.config["arm"]["model"] == "outside"
    assert any(tick.arm is not None for tick in log.ticks)


def test_a_name_that_tams_has_is_not_replaced() -> None:
    command = ("allocate", "--strategy", "tams", "--phase", "ALIGN", "--budget-kbps", "5520")
    assert tams(*command) == tams(*command, environment={"PYTHONPATH": str(ROOT)})
    names = python("-c", "from tams_app.policy.allocation import STRATEGIES; print(*STRATEGIES)")
    assert names.split() == ["equal", "static", "tams", "tams+", "outside"]
