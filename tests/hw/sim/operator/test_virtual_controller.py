from itertools import pairwise

import numpy as np
import pytest

from hw.sim.layout import draw_layout
from hw.sim.operator.demo import TruePerception
from hw.sim.operator.operator import Operator
from tams_app.config import HandConfig, OperatorConfig
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.units import NS_PER_S
from tests.hw.sim.operator.faulty_controller import FaultyController, SensorFault
from tests.hw.sim.operator.toy_robot import TICK_NS, Trial

pytestmark = pytest.mark.untimed


def _controller(config: OperatorConfig | None = None, seed: int = 0) -> FaultyController:
    """In the hand of an operator who sees nothing and so keeps still."""
    config = config or OperatorConfig()
    operator = Operator(HandConfig(), config, TruePerception(lambda: None), seed)
    controller = FaultyController(operator, config, seed)
    controller.start()
    return controller


def _samples(controller: FaultyController, count: int, first: int = 0) -> list[ControllerSample]:
    return [controller.sample(NS_PER_S + (first + n) * TICK_NS) for n in range(count)]


@pytest.fixture
def working() -> Trial:
    """A trial in which the trigger is held."""
    trial = Trial(draw_layout(0))
    trial.run(3.0)
    assert trial.tick().trigger == 1.0
    return trial


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


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (SensorFault.TRACKING_LOST, ControllerStatus.TRACKING_LOST),
        (SensorFault.STANDBY, ControllerStatus.STANDBY),
        (SensorFault.DISCONNECTED, ControllerStatus.DISCONNECTED),
        (SensorFault.RUNTIME_QUIT, ControllerStatus.RUNTIME_QUIT),
        (SensorFault.ROLE_SWAPPED, ControllerStatus.ROLE_SWAPPED),
        (SensorFault.TRACKING_FRAME_CHANGED, ControllerStatus.TRACKING_FRAME_CHANGED),
    ],
)
def test_a_controller_that_is_not_tracked_has_no_pose(working, fault, status):
    before = working.tick()
    working.controller.inject(fault)
    sample = working.tick()
    assert sample.status is status
    assert sample.pose is None
    assert sample.pose_ns == before.pose_ns


@pytest.mark.parametrize(
    "fault",
    [
        SensorFault.STANDBY,
        SensorFault.DASHBOARD,
        SensorFault.DISCONNECTED,
        SensorFault.RUNTIME_QUIT,
        SensorFault.ROLE_SWAPPED,
        SensorFault.TRACKING_FRAME_CHANGED,
    ],
)
def test_buttons_that_cannot_be_read_are_released_and_grow_old(working, fault):
    before = working.tick()
    working.controller.inject(fault)
    for sample in (working.tick(), working.tick()):
        assert sample.trigger == 0.0
        assert sample.buttons_ns == before.buttons_ns


def test_an_open_dashboard_still_tracks(working):
    working.controller.inject(SensorFault.DASHBOARD)
    sample = working.tick()
    assert sample.status is ControllerStatus.DASHBOARD
    assert sample.pose is not None
    assert sample.pose_ns == working.now_ns


def test_a_frozen_pose_keeps_its_value_and_its_time_while_buttons_go_on(working):
    before = working.tick()
    working.controller.inject(SensorFault.FROZEN_POSE)
    working.tick()
    sample = working.tick()
    assert sample.status is ControllerStatus.OK
    assert sample.pose is before.pose
    assert sample.pose_ns == before.pose_ns
    assert sample.buttons_ns == working.now_ns
    assert sample.trigger == 1.0


def test_frozen_buttons_keep_the_trigger_while_the_pose_goes_on(working):
    before = working.tick()
    working.controller.inject(SensorFault.FROZEN_BUTTONS)
    sample = working.tick()
    assert sample.status is ControllerStatus.OK
    assert sample.trigger == 1.0
    assert sample.buttons_ns == before.buttons_ns
    assert sample.pose_ns == working.now_ns


def test_a_fault_that_ends_leaves_a_working_controller(working):
    working.controller.inject(SensorFault.RUNTIME_QUIT)
    working.run(0.5)
    working.controller.inject(None)
    sample = working.tick()
    assert sample.status is ControllerStatus.OK
    assert sample.pose_ns == sample.buttons_ns == working.now_ns


@pytest.mark.parametrize("fault", [SensorFault.DISCONNECTED, SensorFault.ROLE_SWAPPED])
def test_a_controller_that_is_not_in_the_hand_passes_no_pulses_on(fault):
    controller = _controller()
    felt: list[Haptic] = []
    controller.operator.feel = felt.append  # type: ignore[method-assign]
    controller.pulse(Haptic.ENGAGE)
    controller.inject(fault)
    controller.pulse(Haptic.FAULT)
    assert felt == [Haptic.ENGAGE]


def test_a_closed_controller_reads_as_disconnected_and_released(working):
    working.controller.close()
    working.controller.close()
    sample = working.controller.sample(working.now_ns + TICK_NS)
    assert sample.status is ControllerStatus.DISCONNECTED
    assert sample.pose is None
    assert sample.trigger == 0.0
