"""Trials made in virtual time, and `run_tams.py calibrate phases --sim` over them."""

from __future__ import annotations

import ast
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.options import PhaseOptions
from calibration.phases import virtual_trial, wizard
from calibration.phases.trials import CODE, infer, motion_of
from calibration.phases.virtual_trial import VideolessTrial
from calibration.phases.wizard import PhaseWizard
from tams_app.config import DEFAULT_CONFIG, PhasesConfig, load_config
from tams_app.policy.phases import PhaseParameters
from tams_app.records import Tick
from tests.scripted_ui import ScriptedUI

pytestmark = [
    pytest.mark.untimed,
    pytest.mark.timeout(900),
]  # simulating takes its time on a busy machine
ROOT = DEFAULT_CONFIG.parent.parent
NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)
SEEDS = (6, 7, 8)  # quick ones
RATE_HZ = 30.0  # of the control loop: a quarter of the usual, for the time that searching takes


@dataclass(frozen=True)
class Calibrated:
    """A configuration calibrated from three simulated trials."""

    config_path: Path
    ui: ScriptedUI
    made: list[VideolessTrial]  # all of them


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory) -> Iterator[Calibrated]:
    config_path = tmp_path_factory.mktemp("simulated") / "tams.yaml"
    shutil.copy(DEFAULT_CONFIG, config_path)
    with config_path.open("a", encoding="utf-8") as file:
        file.write(f"\ncontrol: {{rate_hz: {RATE_HZ:g}}}\n")
    made: list[VideolessTrial] = []

    class Kept(VideolessTrial):
        def __init__(self, *arguments) -> None:
            super().__init__(*arguments)
            made.append(self)

    ui = ScriptedUI()
    options = PhaseOptions(
        config=config_path, sim=True, trials=3, held_out=0, seed=SEEDS[0], yes=True
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual_trial, "VideolessTrial", Kept)
        patch.setattr(wizard, "sensitivity", lambda *_: [])  # held elsewhere, for the time it takes
        assert PhaseWizard(ui, options, lambda: NOON).run() == 0
    return Calibrated(config_path, ui, made)


def places(ticks: list[Tick]) -> np.ndarray:
    return np.array([tick.arm.tcp.position for tick in ticks if tick.arm])


def test_thresholds_from_simulated_trials_beat_the_defaults_on_a_trial_not_seen(
    calibrated,
) -> None:
    config = load_config(calibrated.config_path)
    (name,) = config.calibrated_by
    file = calibrated.config_path.parent / "calibration" / "rig" / name
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    figures = content["calibration"]["quality"]
    assert content["calibration"]["source"] == "simulated trials, seed 6 to seed 8"
    assert figures["trials"] == 3
    assert figures["accuracy_leave_one_trial_out"] > figures["accuracy_defaults"]
    assert figures["mean_recall_leave_one_trial_out"] > figures["mean_recall_defaults"]
    assert config.policy.phases != PhasesConfig()


def test_the_same_seed_gives_the_same_trial_and_another_seed_another(calibrated) -> None:
    again = VideolessTrial(load_config(calibrated.config_path), SEEDS[1])
    for _ in islice(again.perform(), 50):
        pass
    begun = places(again.ticks)
    same, other = (places(made.ticks)[: len(begun)] for made in calibrated.made[1:])
    assert np.ptp(begun, axis=0).max() > 0.01
    assert np.array_equal(begun, same)
    assert not np.array_equal(begun, other)


def test_algorithm_1_over_a_trial_is_what_the_control_loop_said(calibrated) -> None:
    phases = PhasesConfig()
    ticks = calibrated.made[0].ticks
    motion = motion_of("the first", ticks, ticks[0].started_ns, phases.smoothing_ms)
    said = [CODE[tick.phase] for tick in ticks]
    assert infer(motion, phases).tolist() == said
    assert len(set(said)) > 1
    defaults = load_config(DEFAULT_CONFIG).policy.phases
    assert PhaseParameters.of(defaults) == PhaseParameters.of(phases)


def test_every_trial_ends_with_the_block_in_the_container(calibrated) -> None:
    for trial in calibrated.made:
        last = trial.scene[-1]
        beside = last.container.rotation.inv().apply(last.block.position - last.container.position)
        assert np.abs(beside[:2]).max() < 0.045


def imports_of(module: str) -> set[str]:
    """What the top of a module of this repository imports, and the packages it is in."""
    path = ROOT / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    found = {module.rpartition(".")[0]} - {""}
    if not file.is_file():
        return found
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def test_recorded_trials_need_no_simulator() -> None:
    """As on a machine with the hardware, where MuJoCo is not installed."""
    seen, waiting = set[str](), {"calibration.phases.wizard"}
    while waiting:
        module = waiting.pop()
        seen.add(module)
        waiting |= imports_of(module) - seen
    assert "tams_app.policy.phases" in seen
    assert "mujoco" not in seen
