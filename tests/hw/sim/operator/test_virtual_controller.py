from itertools import pairwise

import numpy as np
import pytest

from hw.sim.operator.demo import TruePerception
from hw.sim.operator.operator import SimulatedOperator
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import HandConfig, OperatorConfig, load_config
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.units import NS_PER_S
from tests.hw.sim.operator.toy_robot import TICK_NS

pytestmark = pytest.mark.untimed


def _controller(config: OperatorConfig | None = None, seed: int = 0) -> VirtualController:
    """In the hand of an operator who sees nothing and so keeps still."""
    config = config or OperatorConfig()
    operator = SimulatedOperator(HandConfig(), config, TruePerception(lambda: None), seed)
    controller = VirtualController(operator, config, seed, rig_wiring(load_config()))
    controller.start()
    return controller


def _samples(controller: VirtualController, count: int) -> list[ControllerSample]:
    return [controller.sample(NS_PER_S + n * TICK_NS) for n in range(count)]


def test_a_live_pose_is_new_in_every_sample():
    samples = _samples(_controller(), 200)
    assert all((a.pose.position != b.pose.position).all() for a, b in pairwise(samples))
    assert all(s.pose_ns == s.buttons_ns == NS_PER_S + n * TICK_NS for n, s in enumerate(samples))
    assert all(sample.status is ControllerStatus.OK for sample in samples)


def test_noise_is_as_large_as_configured_and_seeded():
    config = OperatorConfig(position_noise_mm=2.0, rotation_noise_deg=1.0)
    samples = _samples(_controller(config), 4000)
    positions = np.array([sample.pose.position for sample in samples])
    turns = np.array([sample.pose.rotation.as_rotvec() for sample in samples])
    assert positions.std(axis=0).mean() == pytest.approx(0.002, rel=0.2)
    assert np.degrees(turns.std(axis=0).mean()) == pytest.approx(1.0, rel=0.2)
    again = _samples(_controller(config), 100)
    assert (again[-1].pose.position == positions[99]).all()
    other = _samples(_controller(config, seed=1), 100)
    assert (other[-1].pose.position != positions[99]).all()


def test_without_noise_the_tremor_still_keeps_the_pose_alive():
    samples = _samples(_controller(OperatorConfig(position_noise_mm=0, rotation_noise_deg=0)), 50)
    assert len({sample.pose.position.tobytes() for sample in samples}) == 50
