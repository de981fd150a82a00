"""What counts as a stroke, live and in a recorded session."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import transform

from calibration.frame.fit import BeginAgainError, RefusedError, fit_strokes, turn_deg
from calibration.frame.sources import StrokeCapture, find_strokes, strokes_of_log
from tams_app.config import load_config
from tams_app.errors import LogError
from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S
from tests.calibration.frame.synthetic import stroke
from tests.synthetic_session import header, tick, write_log

pytestmark = pytest.mark.untimed

STEP_NS = NS_PER_S // 120
TRUTH = transform.Rotation.random(random_state=11).as_matrix()


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
    assert len(player.capture.so_far) == 20
    done = player.give(0.0, x=9.0)
    assert done[:, 0] == pytest.approx(np.arange(20) / 100)
    assert player.capture.so_far is None


def test_a_recentred_headset_ends_everything_even_between_strokes():
    player = Player()
    player.give(0.0)
    with pytest.raises(BeginAgainError, match="The headset was recentred"):
        player.give(0.0, status=ControllerStatus.TRACKING_FRAME_CHANGED)


def session(*positions, arming="disarmed"):
    """The ticks of a session in which each of `positions` was made with the trigger held."""
    ticks = []

    def add(place, trigger):
        base = tick(len(ticks))
        pose = Pose(np.asarray(place), Rotation.identity())
        hand = replace(base.controller, pose=pose, trigger=trigger)
        ticks.append(replace(base, controller=hand, arming=arming))

    for part in positions:
        for place in part:
            add(place, 1.0)
        for _ in range(20):
            add(part[-1], 0.0)
    first = [replace(ticks[0], controller=replace(ticks[0].controller, trigger=0.0))]
    return first + ticks


def rounds(count, random):
    return [
        stroke(TRUTH, axis, random, samples=120, noise_m=0.001).positions
        for _ in range(count)
        for axis in range(3)
    ]


def recorded_session(tmp_path, on_the_rig):
    """A session's folder with two rounds of strokes."""
    folder = tmp_path / "logs"
    folder.mkdir()
    config = {"rig": {"enabled": on_the_rig}}
    made = session(*rounds(2, np.random.default_rng(0)))
    write_log(folder / "session.mcap", made, header(config=config))
    return folder


def test_the_strokes_of_a_session_give_the_frame():
    made = rounds(2, np.random.default_rng(0))
    found = find_strokes(session(*made), load_config())
    assert [one.axis for one in found] == [0, 1, 2, 0, 1, 2]
    assert turn_deg(fit_strokes(found).rotation, TRUTH) < 0.5


def test_a_squeeze_without_motion_is_no_stroke():
    made = rounds(1, np.random.default_rng(1))
    squeeze = np.tile(made[0][-1], (30, 1))
    found = find_strokes(session(made[0], squeeze, *made[1:]), load_config())
    assert len(found) == 3


def test_a_session_that_drove_the_arm_is_refused_with_the_reason():
    made = rounds(1, np.random.default_rng(2))
    with pytest.raises(RefusedError, match="shows the mapping in force and not the true"):
        find_strokes(session(*made, arming="engaged"), load_config())


@pytest.mark.parametrize("count", [0, 1, 2, 4])
def test_a_number_of_strokes_that_is_no_round_is_refused(count):
    made = rounds(2, np.random.default_rng(3))[:count] or [np.zeros((30, 3))]
    with pytest.raises(RefusedError, match=f"has {count} strokes"):
        find_strokes(session(*made), load_config())


def test_which_of_several_sessions_is_no_use_is_told(tmp_path, monkeypatch):
    made = session(*rounds(1, np.random.default_rng(3))[:2])
    monkeypatch.setattr("calibration.frame.sources.read_ticks", lambda _: made)
    (tmp_path / "session.mcap").touch()
    with pytest.raises(RefusedError, match=f"{tmp_path}: The session has 2 strokes"):
        strokes_of_log(tmp_path, load_config())


def test_a_folder_without_a_session_is_one_sentence(tmp_path):
    with pytest.raises(LogError, match=r"holds no session\.mcap: give a session folder"):
        strokes_of_log(tmp_path, load_config())
