"""Every component of a controller, however its buttons are mapped."""

import pytest

from calibration.frame.sources import LiveSetup
from hw.openvr.devices import ComponentReader
from tams_app.config import ControllerConfig, load_config
from tams_app.errors import DeviceError
from tams_app.records import ControllerStatus
from tams_app.runtime.clock import MonotonicClock
from tests.hw.openvr.fake_openvr import RIGHT

pytestmark = pytest.mark.waiting


@pytest.fixture
def components(fake):
    components = ComponentReader(
        ControllerConfig(mapping={"vive_focus3_controller": {"a": "b/click", "b": "a/click"}})
    )
    yield components
    components.close()


def test_each_component_is_told_by_its_own_name_whatever_the_mapping(fake, components):
    fake.devices[RIGHT].axes[1] = (0.75, 0.0)
    fake.devices[RIGHT].pressed = 1 << 7  # A
    reading = components.read()
    assert reading.controller_type == "vive_focus3_controller"
    assert reading.values == {
        "trigger/pull": 0.75,
        "grip/pull": 0.0,
        "joystick/click": 0.0,
        "a/click": 1.0,
        "b/click": 0.0,
    }


@pytest.mark.parametrize(
    ("kind", "bits", "pad", "pressed"),
    [
        ("vive_focus3_controller", 1 << 7, (0, 0), {"a/click"}),
        ("vive_focus3_controller", 1 << 1, (0, 0), {"b/click"}),
        ("vive_focus3_controller", 1 << 32, (0, 0), {"joystick/click"}),
        ("vive_controller", 1 << 32, (0, -0.8), {"trackpad/south"}),
        ("vive_controller", 1 << 32, (0, 0.8), {"trackpad/north"}),
        ("vive_controller", 1 << 32, (0.1, 0.1), set()),
        ("vive_controller", 0, (0, 0.9), set()),  # touched only
        ("vive_controller", 1 << 1, (0, 0), {"application_menu/click"}),
        ("vive_controller", 1 << 2, (0, 0), {"grip/click"}),
        ("knuckles", 1 << 2, (0, 0), {"a/click"}),
        ("knuckles", 1 << 1, (0, 0), {"b/click"}),
        ("knuckles", 1 << 35, (0, 0), {"thumbstick/click"}),
    ],
)
def test_each_button_is_found_where_the_type_has_it(fake, components, kind, bits, pad, pressed):
    hand = fake.devices[RIGHT]
    hand.controller_type, hand.pressed, hand.axes[0] = kind, bits, pad
    values = components.read().values
    assert {path for path, value in values.items() if value > 0.5} == pressed


def test_a_controller_that_is_away_and_input_that_is_taken_give_nothing(fake, components):
    fake.dashboard = True
    assert components.read() is None
    fake.dashboard = False
    fake.devices[RIGHT].connected = False
    assert components.read() is None


def test_an_unknown_type_is_named(fake, components):
    fake.devices[RIGHT].controller_type = "oculus_touch"
    with pytest.raises(DeviceError, match=r"type oculus_touch are not known.*--no-buttons"):
        components.read()


def test_a_runtime_that_quits_is_told_and_let_go(fake, components):
    fake.quit()
    with pytest.raises(DeviceError, match="SteamVR has quit"):
        components.read()
    assert fake.quits_acknowledged == 1


def test_the_wizard_reads_the_components_first_and_then_the_pose(fake):
    config = load_config()
    setup = LiveSetup(config, MonotonicClock(), lambda *_: None)
    with setup.buttons() as source:
        assert source.next()[1].values["trigger/pull"] == 0.0
    assert fake.connections == 0
    with setup.hand(config.controller) as source:
        now_ns, sample = source.next()
        assert sample.status is ControllerStatus.OK
        assert sample.pose.position == pytest.approx((0.2, 1.1, -0.3), abs=1e-6)
        assert sample.pose_ns <= now_ns
    assert fake.connections == 0
