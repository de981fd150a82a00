"""Where overlays stand, over the faked function table; tests/faces/headset has their pictures."""

import numpy as np
import openvr
import pytest
from scipy.spatial.transform import Rotation

from hw.openvr.overlays import Overlays
from hw.openvr.runtime import OpenVrRuntime
from tams_app.errors import DeviceError
from tests.hw.openvr.fake_openvr import HEADSET

pytestmark = pytest.mark.untimed

FRONT, SIDE = np.eye(4), np.eye(4)
FRONT[:3, 3] = (0.0, 0.0, -1.5)
SIDE[:3, 3] = (0.8, 0.1, -1.2)
RECENTRED = openvr.VREvent_StandingZeroPoseReset


@pytest.fixture
def fake(fake):
    fake.overlays.reads_back = False
    return fake


@pytest.fixture
def runtime(fake):
    runtime = OpenVrRuntime.join()
    yield runtime
    runtime.close()


def made(runtime, follow_head=False):
    overlays = Overlays(runtime, ("front", "side"), follow_head)
    overlays.arrange(0, FRONT, 1.1)
    overlays.arrange(1, SIDE, 0.6)
    return overlays


@pytest.fixture
def standing(fake, runtime):
    """Overlays that stand in the room, around a head that looks straight on."""
    overlays = made(runtime)
    fake.devices[HEADSET].put((0.0, 1.6, 0.0))
    assert overlays.look() == ""
    return overlays


def position(fake, key):
    return fake.overlays.of(key).transform[:, 3]


def is_shown(fake):
    return [overlay.shown for overlay in fake.overlays.by_handle.values()]


def test_at_the_head_they_follow_it_from_the_first_look(fake, runtime):
    fake.devices[HEADSET].valid = False
    overlays = made(runtime, follow_head=True)
    assert overlays.look() == ""
    for key, pose in (("tams.front", FRONT), ("tams.side", SIDE)):
        overlay = fake.overlays.of(key)
        assert overlay.of == "head"
        assert np.allclose(overlay.transform, pose[:3])
        assert overlay.shown
    assert fake.overlays.of("tams.front").width_m == pytest.approx(1.1)


def test_in_the_room_they_stand_around_where_the_head_is(fake, runtime):
    fake.devices[HEADSET].put((1.0, 1.6, 2.0))
    overlays = made(runtime)
    assert overlays.look() == ""
    assert fake.overlays.of("tams.front").of == "room"
    assert np.allclose(position(fake, "tams.front"), (1.0, 1.6, 0.5))
    assert np.allclose(position(fake, "tams.side"), (1.8, 1.7, 0.8))
    assert is_shown(fake) == [True, True]


@pytest.mark.parametrize(
    ("nod_deg", "tilt_deg"), [(0, 0), (0, 90), (-40, -30), (30, -30), (-89, 0), (90, 0)]
)
def test_they_stand_upright_on_the_side_that_a_nodding_or_tilted_head_faces(
    fake, runtime, nod_deg, tilt_deg
):
    left_deg = 90.0  # turned to the left it looks along -x
    head = Rotation.from_euler("YXZ", (left_deg, nod_deg, tilt_deg), degrees=True)
    fake.devices[HEADSET].put((0.0, 1.6, 0.0), head)
    made(runtime).look()
    assert np.allclose(position(fake, "tams.front"), (-1.5, 1.6, 0.0), atol=1e-6)
    up = fake.overlays.of("tams.front").transform[:, 1]
    assert np.allclose(up, (0.0, 1.0, 0.0), atol=1e-6)


def test_in_the_room_they_stay_when_the_head_moves(fake, standing):
    before = position(fake, "tams.front").copy()
    fake.devices[HEADSET].put((0.5, 1.2, 0.3), Rotation.from_euler("y", 70, degrees=True))
    fake.overlays.done.clear()
    standing.look()
    assert np.array_equal(position(fake, "tams.front"), before)
    assert fake.overlays.done == []


def test_until_the_head_is_tracked_they_are_not_shown(fake, runtime):
    device = fake.devices[HEADSET]
    device.valid = False
    overlays = made(runtime)
    overlays.look()
    assert is_shown(fake) == [False, False]
    device.valid = True
    device.put((0.0, 1.6, 0.0))
    overlays.look()
    assert is_shown(fake) == [True, True]


@pytest.mark.parametrize(
    ("rest", "moves"),
    [
        (openvr.k_EDeviceActivityLevel_Standby, True),
        (openvr.k_EDeviceActivityLevel_Idle, False),
    ],
    ids=["taken off", "at rest for a moment"],
)
def test_a_headset_that_is_put_on_again_has_them_before_it(fake, standing, rest, moves):
    device = fake.devices[HEADSET]
    device.activity = rest
    standing.look()
    device.put((0.3, 1.6, 0.0))
    device.activity = openvr.k_EDeviceActivityLevel_UserInteraction
    standing.look()
    assert position(fake, "tams.front")[0] == pytest.approx(0.3 if moves else 0.0)


def test_recentring_brings_them_before_the_head(fake, standing):
    fake.devices[HEADSET].put((0.0, 1.6, 0.0), Rotation.from_euler("y", -90, degrees=True))
    fake.events.append(RECENTRED)
    standing.look()
    assert np.allclose(position(fake, "tams.front"), (1.5, 1.6, 0.0), atol=1e-6)
    assert is_shown(fake) == [True, True]


def test_a_runtime_that_quits_is_told_of_and_acknowledged(fake, standing):
    fake.quit()
    assert standing.look() == "SteamVR has quit"
    assert fake.quits_acknowledged == 1


def test_overlays_of_another_tams_are_one_sentence(fake, runtime):
    made(runtime)
    with pytest.raises(DeviceError, match=r"refuses the overlays \(OverlayError_KeyInUse\)"):
        made(runtime)
