import openvr
import pytest

from hw.openvr.devices import DeviceIdentity, identify, list_controllers
from hw.openvr.runtime import OpenVrRuntime
from tests.hw.openvr.fake_openvr import LEFT, RIGHT, SPARE, FakeDevice

pytestmark = pytest.mark.untimed


def test_controllers_are_listed_with_what_they_tell_of_themselves(fake):
    fake.devices[RIGHT].battery = 0.25
    fake.devices[LEFT].battery = None
    fake.devices[LEFT].result = openvr.TrackingResult_Running_OutOfRange
    fake.devices[SPARE] = FakeDevice("", controller_type="knuckles", model="", connected=False)
    right, left, spare = list_controllers()
    assert (right.role, right.serial, right.battery) == ("right", "CTL_RIGHT", 0.25)
    assert (right.controller_type, right.model) == (
        "vive_focus3_controller",
        "VIVE Focus 3 Controller",
    )
    assert (right.connected, right.tracked) == (True, True)
    assert (left.role, left.battery, left.tracked) == ("left", None, False)
    assert (spare.role, spare.serial, spare.model) == ("", "", "")
    assert (spare.connected, spare.tracked) == (False, False)


def test_listing_neither_starts_a_runtime_nor_stays_connected(fake):
    list_controllers()
    assert fake.joined_as == [openvr.VRApplication_Background]
    assert fake.connections == 0


def test_devices_without_a_serial_number_are_told_apart_by_their_index(fake):
    fake.devices[SPARE] = FakeDevice("")
    runtime = OpenVrRuntime.join()
    assert identify(runtime, SPARE) == DeviceIdentity("device 7", "vive_focus3_controller")
    assert identify(runtime, RIGHT).serial == "CTL_RIGHT"
    runtime.close()
