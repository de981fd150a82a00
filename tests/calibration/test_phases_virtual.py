"""Trials made in virtual time, and `run_tams.py calibrate phases --sim` over them."""

from __future__ import annotations

import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from calibration.options import PhaseOptions
from calibration.phases.fit import CODE, NOT_COUNTED, infer, motion_of
from calibration.phases.labels import virtual_trials
from calibration.phases.wizard import PhaseWizard
from tams_app.config import DEFAULT_CONFIG, Config, PhasesConfig, load_config
from tams_app.records import Tick
from tams_app.session.virtual import videoless
from tams_app.session.virtual.videoless import VideolessTrial
from tests.calibration.lab import in_force, write_lab
from tests.scripted_ui import ScriptedUI

pytestmark = [
    pytest.mark.untimed,
    pytest.mark.timeout(900),
]  # simulating takes its time on a busy machine
ROOT = DEFAULT_CONFIG.parent.parent
SEED = 6  # it and the next two are quick ones
# a quarter of the usual, for the time that searching takes
SLOW = {"control": {"rate_hz": 30}}


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Config:
    return load_config(write_lab(tmp_path_factory.mktemp("simulated"), **SLOW))


@pytest.fixture(scope="module")
def made(config) -> VideolessTrial:
    """A trial to its end."""
    trial = VideolessTrial(config, SEED)
    assert list(trial.perform())
    return trial


def places(ticks: list[Tick]) -> np.ndarray:
    return np.array([tick.arm.tcp.position for tick in ticks if tick.arm])


@pytest.mark.verify
def test_thresholds_from_simulated_trials_beat_the_defaults_on_a_trial_not_seen(
    tmp_path,
) -> None:
    config_path = write_lab(tmp_path, **SLOW)
    options = PhaseOptions(config=config_path, sim=True, trials=3, held_out=0, seed=SEED)
    assert PhaseWizard(ScriptedUI(), options).run() == 0
    config = load_config(config_path)
    calibration = in_force(config_path)[1]["calibration"]
    figures = calibration["quality"]
    assert calibration["source"] == "simulated trials, seed 6 to seed 8"
    assert figures["trials"] == 3
    assert figures["accuracy_leave_one_trial_out"] > figures["accuracy_defaults"]
    assert figures["mean_recall_leave_one_trial_out"] > figures["mean_recall_defaults"]
    assert config.policy.phases != PhasesConfig()


@pytest.mark.verify
def test_simulated_trials_come_labelled_and_the_last_are_held_out(
    config, made, monkeypatch
) -> None:
    monkeypatch.setattr(videoless, "VideolessTrial", lambda *_: made)
    monkeypatch.setattr(made, "perform", lambda: iter([1.0]))
    seeds, told = (SEED, SEED + 1, SEED + 2), []
    found = virtual_trials(config, seeds, 1, lambda *progress: told.append(progress))
    assert [trial.name for trial in found.trials] == ["seed 6", "seed 7"]
    assert [trial.name for trial in found.held_out] == ["seed 8"]
    assert found.source == "simulated trials, seed 6 to seed 7"
    assert set(found.trials[0].labels) == {NOT_COUNTED, *CODE.values()}
    assert len(told) == 3


def test_the_same_seed_gives_the_same_trial_and_another_seed_another(config, made) -> None:
    def begun(seed: int) -> np.ndarray:
        trial = VideolessTrial(config, seed)
        for _ in islice(trial.perform(), 50):
            pass
        return places(trial.ticks)

    first, other = begun(SEED), begun(SEED + 1)
    assert np.ptp(first, axis=0).max() > 0.01
    assert np.array_equal(first, places(made.ticks)[: len(first)])
    assert not np.array_equal(first, other)


def test_algorithm_1_over_a_trial_is_what_the_control_loop_said(made) -> None:
    phases = PhasesConfig()
    ticks = made.ticks
    motion = motion_of("the first", ticks, ticks[0].started_ns, phases.smoothing_ms)
    said = [CODE[tick.phase] for tick in ticks]
    assert infer(motion, phases).tolist() == said
    assert len(set(said)) > 1
    assert load_config(DEFAULT_CONFIG).policy.phases == phases


def test_a_trial_ends_with_the_block_in_the_container(made) -> None:
    assert made._trial.outcome("").success


def test_recorded_trials_need_no_simulator() -> None:
    """As on a machine with the hardware, where MuJoCo is not installed."""
    load = "import sys; sys.modules['mujoco'] = None; import calibration.phases.wizard"
    subprocess.run([sys.executable, "-c", load], cwd=ROOT, check=True, timeout=100)
