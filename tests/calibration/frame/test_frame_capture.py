"""What counts as a stroke and as a touch."""

import numpy as np
import pytest

from calibration.frame.capture import Held, StrokeCapture, touch_of
from calibration.frame.stroke import RefusedError, StrokeFault
from tams_app.config import load_config
from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed

STEP_NS = NS_PER_S // 120


class Player:
    """Feeds samples, one control period apart."""

    def __init__(self):
        self.capture = StrokeCapture(load_config())
        self.now_ns = NS_PER_S

    def give(self, trigger, x=0.0, status=ControllerStatus.OK, new_pose=True):
        self.now_ns += STEP_NS
        pose = Pose(np.array([x, 1.0, 0.0]), Rotation.identity())
        if status is not ControllerStatus.OK:
            pose = None
        pose_ns = self.now_ns if new_pose else self.now_ns - STEP_NS
        sample = ControllerSample.released(status, pose, pose_ns, self.now_ns, trigger)
        return self.capture.take(sample, self.now_ns)


def test_a_stroke_is_what_arrives_between_squeeze_and_release():
    player = Player()
    # a trigger that was held from the start begins no stroke
    assert [player.give(trigger, x=9.0) for trigger in (1.0, 1.0, 0.0)] == [None] * 3
    held = [player.give(1.0, x=n / 100) for n in range(20)]
    held.append(player.give(1.0, x=0.19, new_pose=False))  # it counts once
    assert held == [None] * 21
    assert len(player.capture.so_far.poses) == 20
    done = player.give(0.0, x=9.0)
    assert done.positions[:, 0] == pytest.approx(np.arange(20) / 100)
    assert player.capture.so_far is None


def test_a_recentred_headset_ends_everything_even_between_strokes():
    player = Player()
    player.give(0.0)
    with pytest.raises(RefusedError) as caught:
        player.give(0.0, status=ControllerStatus.TRACKING_FRAME_CHANGED)
    assert caught.value.reason is StrokeFault.FRAME_CHANGED


def held_at(places):
    return Held(tuple(Pose(np.array([x, 0.0, 0.0]), Rotation.identity()) for x in places))


def test_a_touch_is_where_the_hand_mostly_was():
    touch = touch_of(held_at([0.1] * 30 + [0.11]), np.zeros(3), 1)
    assert touch.hand[0] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("places", "reason"),
    [
        ([0.1] * 5, StrokeFault.TOO_FEW_SAMPLES),
        ([], StrokeFault.TOO_FEW_SAMPLES),
        (np.linspace(0, 0.1, 40), StrokeFault.NOISY),
    ],
)
def test_a_touch_that_was_short_or_moved_is_refused(places, reason):
    with pytest.raises(RefusedError) as caught:
        touch_of(held_at(places), np.zeros(3), 3)
    assert caught.value.reason is reason
    assert "oint 3" in str(caught.value)
