import pytest

from hw.openvr.components import COMPONENTS
from hw.openvr.legacy import LegacyButtons, legacy_sources
from hw.openvr.runtime import OpenVrRuntime
from tams_app.config import ControllerConfig
from tams_app.errors import ConfigError
from tests.hw.openvr.fake_openvr import LEFT, RIGHT, FakeRuntime

pytestmark = pytest.mark.untimed


@pytest.fixture
def fake():
    with FakeRuntime().in_place_of_the_library() as fake:
        yield fake


@pytest.fixture
def runtime(fake):
    runtime = OpenVrRuntime.join()
    yield runtime
    runtime.close()


def bit(number: int) -> int:
    return 1 << number


@pytest.mark.parametrize(
    ("kind", "pressed", "pad", "role"),
    [
        ("vive_focus3_controller", bit(7), (0, 0), "a"),
        ("vive_focus3_controller", bit(1), (0, 0), "b"),
        ("vive_focus3_controller", bit(32), (0, 0), "menu"),
        ("vive_controller", bit(32), (0, -0.8), "a"),
        ("vive_controller", bit(32), (0, 0.8), "b"),
        ("vive_controller", bit(1), (0, 0), "menu"),
        ("knuckles", bit(2), (0, 0), "a"),
        ("knuckles", bit(1), (0, 0), "b"),
        ("knuckles", bit(35), (0, 0), "menu"),
    ],
)
def test_each_button_is_found_where_the_type_has_it(fake, runtime, kind, pressed, pad, role):
    fake.devices[RIGHT].pressed = pressed
    fake.devices[RIGHT].axes[0] = pad
    buttons = LegacyButtons(runtime, ControllerConfig()).read(RIGHT, kind)
    assert {name for name in ("a", "b", "menu") if getattr(buttons, name)} == {role}


def test_a_pad_that_is_pressed_in_its_middle_or_only_touched_is_no_button(fake, runtime):
    source = LegacyButtons(runtime, ControllerConfig())
    fake.devices[RIGHT].axes[0] = (0.0, 0.9)
    assert not source.read(RIGHT, "vive_controller").b
    fake.devices[RIGHT].pressed, fake.devices[RIGHT].axes[0] = bit(32), (0.1, 0.1)
    buttons = source.read(RIGHT, "vive_controller")
    assert (buttons.a, buttons.b) == (False, False)


def test_trigger_and_grip_are_analog_and_the_wands_grip_a_button(fake, runtime):
    source = LegacyButtons(runtime, ControllerConfig())
    fake.devices[RIGHT].axes[1:3] = [(0.5, 0.0), (0.25, 0.0)]
    buttons = source.read(RIGHT, "vive_focus3_controller")
    assert (buttons.trigger, buttons.grip) == (0.5, 0.25)
    fake.devices[RIGHT].pressed = bit(2)
    assert source.read(RIGHT, "vive_controller").grip == 1.0


def test_an_unknown_controller_is_read_like_a_focus_3(fake, runtime):
    fake.devices[RIGHT].pressed = bit(7)
    assert LegacyButtons(runtime, ControllerConfig()).read(RIGHT, "oculus_touch").a


def test_a_state_the_runtime_does_not_give_is_unread(fake, runtime):
    source = LegacyButtons(runtime, ControllerConfig())
    fake.devices[LEFT].connected = False
    assert source.read(LEFT, "knuckles") is None
    assert source.unread
    assert source.read(RIGHT, "knuckles") is not None
    assert source.unread == ()


def test_defaults_all_have_their_place_in_the_legacy_state():
    for hand in ("left", "right"):
        assert set(legacy_sources(ControllerConfig(hand=hand))) == set(COMPONENTS)


def test_a_component_without_a_place_is_refused_with_its_key():
    mapping = {"vive_focus3_controller": {"menu": "application_menu/click"}}
    config = ControllerConfig.model_validate({"hand": "left", "mapping": mapping})
    with pytest.raises(ConfigError, match=r"vive_focus3_controller\.menu.*actions"):
        legacy_sources(config)
