import pytest

from hw.openvr.actions import MIN_GAP_NS, PATTERNS, ActionButtons, HapticPlayer, Vibration
from hw.openvr.bindings import COMMITTED_DIRECTORY, MANIFEST_NAME
from hw.openvr.components import ROLES, ButtonReading
from hw.openvr.runtime import OpenVrRuntime
from tams_app.records import Haptic
from tams_app.units import NS_PER_MS, NS_PER_S

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


POLL_NS = 4 * NS_PER_MS


def played(player: HapticPlayer, seconds: float, start_ns: int = 0) -> list[tuple[int, Vibration]]:
    """Time since `start_ns` and vibration of all that a poll every 4 ms hands over."""
    found = []
    for now_ns in range(start_ns, start_ns + round(seconds * NS_PER_S), POLL_NS):
        vibration = player.due(now_ns)
        if vibration is not None:
            found.append((now_ns - start_ns, vibration))
    return found


@pytest.mark.parametrize("haptic", Haptic)
def test_a_pattern_is_played_whole_and_once(haptic):
    player = HapticPlayer()
    player.start(haptic, 0)
    found = played(player, 2.0)
    assert [vibration for _, vibration in found] == [v for _, v in PATTERNS[haptic]]
    for (at_ns, _), (start_s, _) in zip(found, PATTERNS[haptic], strict=True):
        assert 0 <= at_ns - start_s * NS_PER_S <= POLL_NS


def test_nothing_is_handed_over_within_the_smallest_gap():
    player = HapticPlayer()
    player.start(Haptic.RELEASE, 0)
    assert player.due(0) is not None
    player.start(Haptic.RELEASE, 0)
    assert player.due(MIN_GAP_NS - 1) is None
    assert player.due(MIN_GAP_NS) is not None


def test_a_new_pattern_cuts_off_the_old_one():
    player = HapticPlayer()
    player.start(Haptic.LIMIT, 0)
    player.due(0)
    player.start(Haptic.ENGAGE, 10 * NS_PER_MS)
    assert [v for _, v in played(player, 1.0, 10 * NS_PER_MS)] == [PATTERNS[Haptic.ENGAGE][0][1]]


@pytest.mark.parametrize("fault", [Haptic.FAULT, Haptic.LINK_FAULT])
def test_nothing_cuts_off_a_fault(fault: Haptic):
    player = HapticPlayer()
    player.start(fault, 0)
    player.due(0)
    player.start(Haptic.RELEASE, 10 * NS_PER_MS)
    found = played(player, 1.5, 10 * NS_PER_MS)
    assert [v for _, v in found] == [v for _, v in PATTERNS[fault][1:]]
    player.start(Haptic.RELEASE, 2 * NS_PER_S)
    assert player.due(2 * NS_PER_S) == PATTERNS[Haptic.RELEASE][0][1]


def test_after_a_delay_only_the_newest_pulse_is_handed_over():
    player = HapticPlayer()
    player.start(Haptic.FAULT, 0)
    assert player.due(10 * NS_PER_S) is not None
    assert player.due(11 * NS_PER_S) is None


def test_silence_ends_everything():
    player = HapticPlayer()
    player.start(Haptic.FAULT, 0)
    player.silence()
    assert played(player, 1.0) == []
