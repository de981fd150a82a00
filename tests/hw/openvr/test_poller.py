import numpy as np
import openvr
import pytest
from scipy.spatial.transform import Rotation

from hw.openvr.bindings import COMMITTED_DIRECTORY, MANIFEST_NAME
from hw.openvr.poller import OpenVrPoller
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.openvr.fake_openvr import HEADSET, RIGHT, SPARE, FakeDevice, FakeRuntime

pytestmark = pytest.mark.untimed

POLL_NS = 4 * NS_PER_MS


class PollerRig:
    """A poller over a scripted runtime, in virtual time."""

    def __init__(self, runtime: FakeRuntime, **config) -> None:
        self.runtime = runtime
        self.notes: list[str] = []
        self.now_ns = NS_PER_S
        manifest = COMMITTED_DIRECTORY / MANIFEST_NAME
        self.poller = OpenVrPoller(ControllerConfig(**config), manifest, self._note)

    def step(self) -> ControllerSample:
        self.now_ns += POLL_NS
        return self.poller.step(self.now_ns)

    def run(self, seconds: float) -> ControllerSample:
        end_ns = self.now_ns + round(seconds * NS_PER_S)
        while self.now_ns < end_ns:
            sample = self.step()
        return sample

    def told(self, text: str) -> int:
        return sum(text in note for note in self.notes)

    def _note(self, level: str, text: str) -> None:
        self.notes.append(f"{level}: {text}")


@pytest.fixture
def rig(fake):
    rig = PollerRig(fake)
    rig.poller.connect()
    yield rig
    rig.poller.close()


def swap(runtime: FakeRuntime) -> None:
    """Another controller plays the hand."""
    spare = runtime.devices[SPARE] = FakeDevice("CTL_SPARE")
    spare.put((0.5, 1.0, 0.0))
    runtime.give_hand_to(SPARE)


# --- what it reads ------------------------------------------------------------------------------


def test_pose_and_buttons_of_the_right_hand_are_read(rig):
    turn = Rotation.from_euler("xyz", (20, -35, 70), degrees=True)
    rig.runtime.devices[RIGHT].put((0.25, 1.5, -0.75), turn)
    rig.runtime.press("trigger", 0.75)
    rig.runtime.press("grip", 0.5)
    rig.runtime.press("b")
    rig.runtime.press("trigger", 0.25, hand="left")
    sample = rig.step()
    assert sample.status is ControllerStatus.OK
    assert sample.pose.position.tolist() == [0.25, 1.5, -0.75]
    assert (Rotation.from_quat(sample.pose.rotation).inv() * turn).magnitude() < 1e-6
    assert (sample.trigger, sample.grip) == (0.75, 0.5)
    assert (sample.a, sample.b, sample.menu) == (False, True, False)
    assert sample.pose_ns == sample.buttons_ns == rig.now_ns


def test_a_left_handed_operator_uses_the_left_controller(fake):
    rig = PollerRig(fake, hand="left")
    rig.poller.connect()
    fake.press("trigger", 1.0, hand="left")
    fake.press("menu", hand="right")
    rig.poller.play(Haptic.ENGAGE, rig.now_ns)
    sample = rig.run(0.2)
    assert sample.pose.position[0] < 0
    assert sample.trigger == 1.0
    assert not sample.menu
    assert {hand for hand, *_ in fake.vibrations} == {"left"}


def test_a_binding_that_is_missing_is_named_once(rig):
    rig.runtime.bound -= {"menu", "b"}
    rig.run(5.0)
    assert rig.told("no b, menu of the controller") == 1


# --- states of the controller -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("result", "why"),
    [
        (openvr.TrackingResult_Uninitialized, "not started"),
        (openvr.TrackingResult_Calibrating_InProgress, "calibrating"),
        (openvr.TrackingResult_Calibrating_OutOfRange, "calibrating, out of range"),
        (openvr.TrackingResult_Running_OutOfRange, "out of range"),
        (openvr.TrackingResult_Fallback_RotationOnly, "rotation only"),
    ],
)
def test_a_pose_is_used_only_while_tracking_runs(rig, result, why):
    before = rig.step()
    rig.runtime.devices[RIGHT].result = result
    sample = rig.run(0.5)
    assert sample.status is ControllerStatus.TRACKING_LOST
    assert sample.pose is None
    assert sample.pose_ns == before.pose_ns
    assert sample.buttons_ns == rig.now_ns
    assert rig.told(f"tracking lost, {why}") == 1


@pytest.mark.parametrize(
    ("valid", "place", "value"),
    [
        (False, (0, 0), 1.0),
        (True, np.s_[:, 3], 0.0),
        (True, (1, 1), float("nan")),
        (True, (2, 3), float("inf")),
        (True, np.s_[:, :3], 0.0),
        (True, (0, 0), -1.0),
    ],
    ids=["invalid", "at the origin", "not a number", "nowhere", "no rotation", "mirrored"],
)
def test_a_pose_that_cannot_be_true_is_tracking_lost(rig, valid, place, value):
    rig.step()
    device = rig.runtime.devices[RIGHT]
    device.valid, device.matrix[place] = valid, value
    sample = rig.step()
    assert sample.status is ControllerStatus.TRACKING_LOST
    assert sample.pose is None


@pytest.mark.parametrize(
    "taken",
    [{"dashboard": True, "dashboard_takes_input": False}, {"input_available": False}],
    ids=["buttons come through a dashboard", "another window takes them"],
)
def test_buttons_read_as_released_whatever_takes_them(rig, taken):
    rig.runtime.press("trigger")
    before = rig.step()
    vars(rig.runtime).update(taken)
    sample = rig.step()
    assert sample.status is ControllerStatus.DASHBOARD
    assert (sample.trigger, sample.buttons_ns) == (0.0, before.buttons_ns)


@pytest.mark.parametrize(
    "level", [openvr.k_EDeviceActivityLevel_Standby, openvr.k_EDeviceActivityLevel_Idle_Timeout]
)
def test_a_controller_laid_aside_reads_as_released(rig, level):
    rig.runtime.press("trigger")
    rig.step()
    rig.runtime.devices[RIGHT].activity = level
    sample = rig.step()
    assert sample.status is ControllerStatus.STANDBY
    assert sample.pose is None
    assert sample.trigger == 0.0


@pytest.mark.parametrize(
    "level", [openvr.k_EDeviceActivityLevel_Unknown, openvr.k_EDeviceActivityLevel_Idle]
)
def test_a_hand_that_rests_for_a_moment_is_no_standby(rig, level):
    rig.runtime.devices[RIGHT].activity = level
    assert rig.step().status is ControllerStatus.OK


def test_a_controller_that_is_lost_and_found_is_told_each_time_once(rig):
    rig.runtime.press("trigger")
    rig.run(0.5)
    rig.runtime.devices[RIGHT].connected = False
    sample = rig.run(0.5)
    assert sample.status is ControllerStatus.DISCONNECTED
    assert (sample.pose, sample.trigger) == (None, 0.0)
    rig.runtime.devices[RIGHT].connected = True
    assert rig.run(0.5).status is ControllerStatus.OK
    assert rig.told("warning: controller: disconnected") == 1
    assert rig.told("info: controller: ok") == 2


def test_a_controller_of_an_unknown_type_is_told_once(rig):
    rig.step()
    assert rig.told("not one TAMS knows") == 0
    for _ in range(3):
        rig.runtime.devices[RIGHT].controller_type = "oculus_touch"
        rig.runtime.devices[RIGHT].connected = False
        rig.step()
        rig.runtime.devices[RIGHT].connected = True
        assert rig.step().status is ControllerStatus.OK
    assert rig.told("'oculus_touch' is not one TAMS knows") == 1


# --- another device plays the hand, or the headset was recentred --------------------------------


EACH_CHANGE = pytest.mark.parametrize(
    ("change", "status"),
    [
        (swap, ControllerStatus.ROLE_SWAPPED),
        (FakeRuntime.recentre, ControllerStatus.TRACKING_FRAME_CHANGED),
    ],
    ids=["another device", "a new frame"],
)


@EACH_CHANGE
def test_another_device_or_frame_counts_after_the_trigger_was_up_for_a_second(rig, change, status):
    rig.runtime.press("trigger")
    rig.step()
    change(rig.runtime)
    rig.runtime.press("trigger", 0.3)
    assert rig.run(2.0).status is status
    told = "role swapped, now CTL_SPARE" if change is swap else "tracking frame changed"
    assert rig.told(told) == 1
    rig.runtime.press("trigger", 0.0)
    assert rig.run(0.9).status is status
    rig.runtime.press("trigger", 0.3)
    rig.step()
    rig.runtime.press("trigger", 0.0)
    assert rig.run(0.9).status is status
    assert rig.run(0.2).status is ControllerStatus.OK
    rig.runtime.press("trigger")
    sample = rig.run(1.0)
    assert sample.trigger == 1.0
    assert sample.pose.position[0] == pytest.approx(0.5 if change is swap else -0.3)


@EACH_CHANGE
def test_buttons_that_cannot_be_read_accept_no_other_device_or_frame(rig, change, status):
    rig.step()
    change(rig.runtime)
    rig.runtime.dashboard = True
    assert rig.run(3.0).status is status


@EACH_CHANGE
def test_the_menu_still_stops_the_arm_of_another_device_and_in_another_frame(rig, change, status):
    rig.step()
    change(rig.runtime)
    rig.runtime.press("menu")
    sample = rig.step()
    assert (sample.status, sample.menu) == (status, True)
    assert sample.buttons_ns == rig.now_ns


def test_the_own_device_counts_again_at_once(rig):
    rig.step()
    swap(rig.runtime)
    rig.run(0.1)
    rig.runtime.give_hand_to(RIGHT)
    assert rig.step().status is ControllerStatus.OK


def test_another_device_that_comes_after_the_own_was_lost_is_a_swap_too(rig):
    rig.step()
    rig.runtime.devices[RIGHT].connected = False
    assert rig.step().status is ControllerStatus.DISCONNECTED
    swap(rig.runtime)
    assert rig.step().status is ControllerStatus.ROLE_SWAPPED


def test_another_device_under_the_same_index_is_a_swap_too(rig):
    rig.step()
    rig.runtime.devices[RIGHT].connected = False
    rig.step()
    rig.runtime.devices[RIGHT] = FakeDevice("CTL_NEW", openvr.TrackedControllerRole_RightHand)
    assert rig.step().status is ControllerStatus.ROLE_SWAPPED


def test_the_same_controller_under_another_index_is_no_swap(rig):
    rig.step()
    device = rig.runtime.devices.pop(RIGHT)
    rig.step()
    rig.runtime.devices[SPARE] = device
    assert rig.step().status is ControllerStatus.OK


FRAME_EVENTS = [
    openvr.VREvent_ChaperoneDataHasChanged,
    openvr.VREvent_ChaperoneUniverseHasChanged,
    openvr.VREvent_ChaperoneRoomSetupCommitted,
    openvr.VREvent_SeatedZeroPoseReset,
    openvr.VREvent_StandingZeroPoseReset,
]


@pytest.mark.parametrize("event", FRAME_EVENTS)
def test_a_word_of_a_new_frame_takes_pose_and_trigger_away_in_that_very_step(rig, event):
    rig.runtime.press("trigger")
    before = rig.step()
    rig.runtime.events.append(event)
    sample = rig.step()
    assert sample.status is ControllerStatus.TRACKING_FRAME_CHANGED
    assert (sample.pose, sample.trigger) == (None, 0.0)
    assert sample.pose_ns == before.pose_ns


def test_a_frame_that_turns_without_a_word_is_noticed_in_that_very_step(rig):
    rig.runtime.press("trigger")
    assert rig.step().status is ControllerStatus.OK
    rig.runtime.recentre()
    assert rig.step().status is ControllerStatus.TRACKING_FRAME_CHANGED
    assert rig.run(3.0).status is ControllerStatus.TRACKING_FRAME_CHANGED


def test_a_second_recentring_begins_the_second_anew(rig):
    rig.step()
    rig.runtime.recentre()
    rig.run(0.8)
    rig.runtime.recentre()
    assert rig.run(0.9).status is ControllerStatus.TRACKING_FRAME_CHANGED


@pytest.mark.parametrize("away", ["the runtime quits", "the controller is off"])
def test_a_frame_that_turned_meanwhile_is_noticed_afterwards(rig, away):
    rig.step()
    if away == "the runtime quits":
        rig.runtime.quit()
    else:
        rig.runtime.devices[RIGHT].connected = False
    rig.run(1.5)
    rig.runtime.recentre()
    rig.run(0.5)
    rig.runtime.restart()
    away_still = (ControllerStatus.RUNTIME_QUIT, ControllerStatus.DISCONNECTED)
    back = next(s for s in (rig.step() for _ in range(300)) if s.status not in away_still)
    assert back.status is ControllerStatus.TRACKING_FRAME_CHANGED
    assert rig.run(1.1).status is ControllerStatus.OK


def test_small_corrections_of_the_frame_are_let_pass_until_they_add_up(rig):
    rig.step()
    for _ in range(4):
        rig.runtime.recentre(degrees=0.1)
        assert rig.step().status is ControllerStatus.OK
    rig.runtime.recentre(degrees=0.2)
    assert rig.step().status is ControllerStatus.TRACKING_FRAME_CHANGED


def test_a_frame_that_moves_sideways_is_a_change_too(rig):
    rig.step()
    rig.runtime.standing.matrix[0, 3] += 0.004
    assert rig.step().status is ControllerStatus.OK
    rig.runtime.standing.matrix[0, 3] += 0.004
    assert rig.step().status is ControllerStatus.TRACKING_FRAME_CHANGED


def test_a_frame_that_is_not_a_number_is_a_change(rig):
    rig.step()
    rig.runtime.standing.matrix[0, 0] = float("nan")
    assert rig.step().status is ControllerStatus.TRACKING_FRAME_CHANGED


def test_another_kind_of_event_changes_nothing(rig):
    rig.runtime.events.append(openvr.VREvent_ChaperoneSettingsHaveChanged)
    assert rig.step().status is ControllerStatus.OK


# --- the runtime --------------------------------------------------------------------------------


def test_a_runtime_that_quits_is_acknowledged_and_let_go_at_once(rig):
    rig.runtime.press("trigger")
    rig.step()
    rig.runtime.quit()
    sample = rig.step()
    assert sample.status is ControllerStatus.RUNTIME_QUIT
    assert (sample.pose, sample.trigger) == (None, 0.0)
    assert rig.runtime.quits_acknowledged == 1
    assert rig.runtime.connections == 0


def test_a_runtime_that_was_quit_is_looked_for_but_never_started(rig):
    rig.step()
    rig.runtime.quit()
    before = len(rig.runtime.joined_as)
    rig.run(0.9)
    assert len(rig.runtime.joined_as) == before, "for a second it is left alone"
    assert rig.run(4.1).status is ControllerStatus.RUNTIME_QUIT
    assert 4 <= len(rig.runtime.joined_as) - before <= 5
    assert not rig.runtime.launched
    assert rig.told("SteamVR is not running") == 1


def test_a_runtime_that_comes_back_is_joined_as_an_overlay_with_the_same_actions(rig):
    rig.run(0.5)
    rig.runtime.quit()
    rig.run(3.0)
    rig.runtime.restart()
    rig.runtime.press("trigger", 0.5)
    sample = rig.run(1.5)
    assert sample.status is ControllerStatus.OK
    assert sample.trigger == 0.5
    assert rig.runtime.joined_as[-1] == openvr.VRApplication_Overlay
    assert rig.runtime.connections == 1
    assert rig.told("SteamVR is back") == 1


def test_a_runtime_that_dies_without_a_word_is_noticed_and_joined_again(rig):
    rig.step()
    rig.runtime.die()
    assert rig.run(1.0).status is ControllerStatus.DISCONNECTED
    assert rig.run(1.5).status is ControllerStatus.RUNTIME_QUIT
    assert rig.runtime.connections == 0
    rig.runtime.restart()
    assert rig.run(1.5).status is ControllerStatus.OK


@pytest.mark.parametrize("error", [openvr.VRInputError_IPCError, 4711], ids=["pipe", "unknown"])
def test_a_broken_pipe_or_an_unknown_error_is_a_lost_runtime(rig, error):
    rig.step()
    rig.runtime.update_error = error
    assert rig.step().status is ControllerStatus.RUNTIME_QUIT
    rig.runtime.update_error = openvr.VRInputError_None
    assert rig.run(1.5).status is ControllerStatus.OK


def test_another_input_error_leaves_the_buttons_unread(rig):
    before = rig.step()
    rig.runtime.update_error = openvr.VRInputError_NoActiveActionSet
    sample = rig.step()
    assert sample.status is ControllerStatus.OK
    assert sample.buttons_ns == before.buttons_ns


def test_a_headset_that_goes_to_sleep_alone_is_no_lost_runtime(rig):
    rig.runtime.devices[HEADSET].connected = False
    assert rig.run(3.0).status is ControllerStatus.OK


# --- actions ------------------------------------------------------------------------------------


def test_the_manifest_is_set_before_the_first_event_is_taken(rig):
    rig.step()
    calls = rig.runtime.calls
    assert calls.index("setActionManifestPath") < calls.index("pollNextEvent")
    assert rig.runtime.manifest["action_sets"][0]["name"] == "/actions/tams"


@pytest.mark.parametrize("fault", ["no interface", "manifest refused"])
def test_a_runtime_that_does_not_take_actions_is_refused(fake, fault):
    fake.has_input_interface = fault != "no interface"
    if fault == "manifest refused":
        fake.manifest_error = openvr.VRInputError_MismatchedActionManifest
    rig = PollerRig(fake)
    with pytest.raises(DeviceError, match=r"does not take the actions of TAMS .* update SteamVR"):
        rig.poller.connect()
    assert fake.connections == 0


# --- pulses -------------------------------------------------------------------------------------


def test_each_pulse_feels_different(rig):
    felt = set()
    for haptic in Haptic:
        rig.runtime.vibrations.clear()
        rig.poller.play(haptic, rig.now_ns)
        rig.run(1.0)
        assert all(hand == "right" for hand, *_ in rig.runtime.vibrations)
        felt.add(tuple(rig.runtime.vibrations))
    assert len(felt) == len(Haptic)
    assert () not in felt


def test_a_pulse_without_a_runtime_is_forgotten(rig):
    rig.step()
    rig.poller.play(Haptic.FAULT, rig.now_ns)
    rig.step()
    rig.runtime.quit()
    rig.step()
    rig.poller.play(Haptic.FAULT, rig.now_ns)
    rig.runtime.restart()
    rig.runtime.vibrations.clear()
    rig.run(2.0)
    assert rig.runtime.vibrations == []
