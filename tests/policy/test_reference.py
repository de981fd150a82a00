"""`preset: reference` against the rule of the authors' nodes, written anew from its description."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tams_app.cli import app
from tams_app.config import dump_config, load_config
from tams_app.console.phases import label_phases
from tams_app.errors import ConfigError
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.phases import PhaseInference
from tams_app.records import Phase
from tests.synthetic_session import tick

pytestmark = pytest.mark.untimed

ROWS = 100_000
STILL_MM_S = FALLING_MM_S = 10.0
DWELL_S = 0.2
FLOOR_KBPS = 300
# speeds about the thresholds, and what no arm does
SPEEDS_MM_S = (0.0, -0.0, 9.999999999, 10.0, 10.000000001, -10.0, -10.000000001, -9.999999999, 25.0)
HOSTILE_MM_S = (1e-300, -1e-300, 1e300, -1e300, 5e-324, 1e16, -1e16)
# times between rows: a dwell at once, parts of it that sum to it, almost, and none
STEPS_S = (0.0, 0.02, 0.05, 0.1, 0.2, 0.19999999999, 1 / 120, 1e-12, 3600.0)


def authors_phases(rows: list[tuple[float, float, float, float, int]]) -> list[str]:
    """Their rule: the gripper begins open, nothing is smoothed, an edge leaves the dwell."""
    phase, was_closed, dwell_s, last_s = "REACH", False, 0.0, rows[0][0]
    found = []
    for t_s, x, y, z, gripper in rows:
        period_s, last_s = t_s - last_s, t_s
        closed = gripper == 1
        if closed != was_closed:
            phase = "GRASP" if closed else "RELEASE"
        elif math.hypot(x, y, z) / 1000 > STILL_MM_S / 1000:
            dwell_s = dwell_s + period_s if z / 1000 < -FALLING_MM_S / 1000 else 0.0
            descends = dwell_s >= DWELL_S
            moving, descending = ("TRANSPORT", "PRE_RELEASE") if closed else ("REACH", "ALIGN")
            phase = descending if descends else moving
        was_closed = closed
        found.append(phase)
    return found


def random_rows(seed: int, count: int) -> list[tuple[float, float, float, float, int]]:
    """Stretches in which little changes, between which anything does."""
    draw = np.random.default_rng(seed)
    rows: list[tuple[float, float, float, float, int]] = []
    t_s, gripper = 0.0, int(draw.integers(2))
    while len(rows) < count:
        kind = draw.integers(4)
        fixed = draw.choice(SPEEDS_MM_S, 3)
        for _ in range(int(draw.integers(1, 40))):
            t_s += float(draw.choice(STEPS_S)) if kind else 0.02
            if kind == 1:
                velocity = draw.normal(0.0, 15.0, 3)
            elif kind == 2:
                velocity = draw.choice(HOSTILE_MM_S + SPEEDS_MM_S, 3)
            else:
                velocity = fixed
            rows.append((t_s, *map(float, velocity), gripper))
            if draw.random() < 0.05:
                gripper = 1 - gripper
    return rows[:count]


@pytest.mark.parametrize("seed", range(4))  # of which some begin with a closed gripper
def test_the_phases_are_those_of_the_authors_rule_on_random_and_hostile_rows(seed: int) -> None:
    config = load_config(overrides={"preset": "reference"}).policy.phases
    rows = random_rows(seed, ROWS // 4)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("t_s", "vx_mm_s", "vy_mm_s", "vz_mm_s", "gripper"))
    writer.writerows([*map(repr, row[:4]), row[4]] for row in rows)
    labelled = label_phases(text.getvalue(), "rows", config, config.smoothing_ms / 1000)
    found = [row["phase"] for row in csv.DictReader(io.StringIO(labelled))]
    expected = authors_phases(rows)
    assert len(set(expected)) == len(Phase)
    assert found == expected


def test_in_a_session_the_speed_is_not_smoothed() -> None:
    inference = PhaseInference(load_config(overrides={"preset": "reference"}).policy.phases)
    speeds = []
    for number in range(40):
        arm = tick(number).arm
        inference.step(arm.received_ns, arm)
        speeds.append(inference.speed)
    assert all(math.isfinite(speed) for speed in speeds)


def test_the_bits_are_those_of_the_authors_rule_below_and_above_three_floors() -> None:
    policy = load_config(overrides={"preset": "reference"}).policy
    tams = STRATEGIES["tams"](policy)
    for phase in Phase:
        for budget_kbps in (0, 1, 449, 899, 900, 901, 3000, 6000, 20_000):
            targets = tams.targets(phase, budget_kbps)
            for view, weight in policy.weights.matrix[phase].items():
                spare_kbps = budget_kbps - 3 * FLOOR_KBPS
                exact = budget_kbps / 3 if spare_kbps < 0 else FLOOR_KBPS + weight * spare_kbps
                assert targets[view] == pytest.approx(exact, abs=1.0)


def test_it_is_laid_over_file_and_calibration_and_below_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    text = (
        "version: 1\ninclude: [tams.yaml]\npreset: reference\n"
        "policy: {phases: {v_eps_mm_s: 3}, budget: {safety_factor: 0.5}}\n"
    )
    path.write_text(text)
    policy = load_config(path, {"policy.phases.align_dwell_s": 0.7}).policy
    assert (policy.phases.v_eps_mm_s, policy.phases.vz_min_mm_s) == (10.0, 10.0)
    assert (policy.phases.align_dwell_s, policy.phases.pre_release_dwell_s) == (0.7, 0.2)
    assert (policy.allocation.floor_kbps, policy.budget.safety_factor) == (300.0, 0.5)
    config = load_config(path)
    path.write_text(dump_config(config))
    assert load_config(path) == config
    with pytest.raises(ConfigError, match=r"preset.*reference"):
        load_config(overrides={"preset": "refrence"})


def test_each_command_takes_it(tmp_path: Path) -> None:
    run = CliRunner().invoke
    asked = ["--phase", "Align", "--budget-kbps", "1200", "--preset", "reference", "--json"]
    assert json.loads(run(app, ["allocate", *asked]).stdout)["gt"] == 360
    table = tmp_path / "table.csv"
    table.write_text("t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n0,0,0,0,1\n")
    assert "GRASP" in run(app, ["phases", str(table), "--preset", "reference"]).stdout
    assert "REACH" in run(app, ["phases", str(table)]).stdout
    study = tmp_path / "study"
    planned = ["study", "plan", str(study), "--participants", "18", "--sim"]
    assert run(app, [*planned, "--preset", "reference"]).exit_code == 0
    assert load_config(study / "config.yaml").policy.allocation.floor_kbps == FLOOR_KBPS
