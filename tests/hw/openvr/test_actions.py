import pytest

from hw.openvr.actions import ActionButtons
from hw.openvr.bindings import COMMITTED_DIRECTORY, MANIFEST_NAME
from hw.openvr.components import ROLES, ButtonReading
from hw.openvr.haptics import Vibration
from hw.openvr.runtime import OpenVrRuntime

pytestmark = pytest.mark.untimed

KIND = "vive_controller"


@pytest.fixture
def buttons(fake):
    runtime = OpenVrRuntime.join()
    yield ActionButtons(runtime, COMMITTED_DIRECTORY / MANIFEST_NAME, "right")
    runtime.close()


def test_a_grip_without_a_scale_is_read_from_its_click(fake, buttons):
    fake.bound = (fake.bound - {"grip"}) | {"grip_click"}
    assert buttons.read() == ButtonReading(grip=0.0)
    fake.press("grip_click")
    assert buttons.read() == ButtonReading(grip=1.0)


def test_the_analog_grip_goes_before_its_click(fake, buttons):
    fake.bound.add("grip_click")
    fake.press("grip", 0.25)
    fake.press("grip_click")
    assert buttons.read().grip == 0.25


@pytest.mark.parametrize("role", ROLES)
def test_without_any_one_of_its_actions_nothing_is_read(fake, buttons, role):
    fake.bound.remove(role)
    assert buttons.read() is None
    assert buttons.unread == (role,)
    fake.bound.add(role)
    assert buttons.read() is not None
    assert buttons.unread == ()


def test_a_vibration_is_handed_over_whole(fake, buttons):
    buttons.vibrate(Vibration(0.16, 120.0, 1.0))
    assert fake.vibrations == [("right", 0.16, 120.0, 1.0)]
