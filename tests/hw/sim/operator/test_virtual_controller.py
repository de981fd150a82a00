import numpy as np
import pytest

from hw.sim.operator.demo import TruePerception
from hw.sim.operator.operator import SimulatedOperator
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import HandConfig, OperatorConfig, load_config
from tams_app.errors import ConfigError
from tams_app.records import ControllerSample
from tams_app.units import NS_PER_S
from tests.hw.sim.operator.toy_robot import TICK_NS

pytestmark = pytest.mark.untimed


def _controller(config: OperatorConfig | None = None, seed: int = 0) -> VirtualController:
    """In the hand of an operator who sees nothing and so keeps still."""
    config = config or OperatorConfig()
    eyes, traits = TruePerception(lambda: None), ParticipantProfile.scripted(config)
    operator = SimulatedOperator(HandConfig(), config, eyes, traits, seed)
    controller = VirtualController(operator, config, seed, rig_wiring(load_config()))
    controller.start()
    return controller


def _samples(controller: VirtualController, count: int) -> list[ControllerSample]:
    return [controller.sample(NS_PER_S + n * TICK_NS) for n in range(count)]


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


# --- which components its buttons move, and what the mapping makes of it ------------------------

SWAPPED = {"a": "b/click", "b": "a/click"}
NOTHING = {"trigger": 0.0, "grip": 0.0, "a": 0.0, "b": 0.0, "menu": 0.0}


def roles(overrides, **pressed):
    wiring = rig_wiring(load_config(None, overrides))
    return wiring.roles(wiring.reading(NOTHING | pressed))


@pytest.mark.parametrize("kind", ["vive_focus3_controller", "vive_controller", "knuckles"])
def test_every_part_plays_its_role_unless_it_is_wired_otherwise(kind):
    for role in NOTHING:
        expected = NOTHING | {role: 1.0}
        assert roles({"rig.controller_type": kind}, **{role: 1.0}) == expected


def test_swapped_buttons_arrive_swapped_until_the_mapping_says_so():
    assert roles({"rig.wiring": SWAPPED}, a=1.0) == NOTHING | {"b": 1.0}
    mapping = {"vive_focus3_controller": SWAPPED}
    both = {"rig.wiring": SWAPPED, "controller.mapping": mapping}
    assert roles(both, a=1.0) == NOTHING | {"a": 1.0}
    assert roles(both, trigger=0.3) == NOTHING | {"trigger": 0.3}


def test_a_wiring_that_no_controller_has_is_named():
    with pytest.raises(ConfigError, match=r"rig\.wiring: .*has no x/click"):
        rig_wiring(load_config(None, {"rig.wiring": {"a": "x/click"}}))


def test_the_operator_moves_by_the_true_frame_and_keeps_the_rest_of_the_mapping():
    plain = load_config(None, {"hand.translation_scale": 0.5})
    assert operator_hand(plain) == plain.hand
    turned = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    config = plain.model_copy(
        update={"rig": plain.rig.model_copy(update={"hand_rotation": turned})}
    )
    assert operator_hand(config).rotation == turned
    assert operator_hand(config).translation_scale == 0.5


def test_a_mirrored_frame_of_the_rig_is_refused():
    with pytest.raises(ConfigError, match="rig: hand_rotation is mirrored"):
        load_config(None, {"rig.hand_rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]})
