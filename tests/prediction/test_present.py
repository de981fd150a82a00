import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from tams_app.prediction.forward_model import ArmHeard
from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.present import (
    OLDEST_NS,
    AsReceived,
    MountTrail,
    PredictedCamera,
    Present,
    WristView,
    array_of,
    numbers_of,
)
from tams_app.records import MountPrediction, Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS
from tests.prediction.sides import MODEL, READY_JOINTS, Sides
from tests.prediction.wrist import above, lens_of, picture, placed
from tests.teleop.rig import PERIOD_NS, hand_for

pytestmark = pytest.mark.untimed

START_NS = 1_000_000_000
THEN, NOW = above(0.0, 0.0, 0.20), above(0.02, 0.0, 0.20)


def trail_of(
    now: Pose = NOW, late_ns: int = 100 * NS_PER_MS, steps: int = 40, **more: Any
) -> MountTrail:
    trail = MountTrail()
    for step in range(steps):
        trail.add(placed(START_NS + step * PERIOD_NS, THEN, now, late_ns, **more))
    return trail


def last_ns(steps: int = 40) -> int:
    return START_NS + (steps - 1) * PERIOD_NS


def state(t_ns: int, joints: np.ndarray) -> ArmHeard:
    return ArmHeard(t_ns, joints, None, ArmingState.READY, False, 1.0)


def figure_of(mount: Callable[[np.ndarray], Pose]) -> Any:
    """Of an arm whose joints put its flange there."""
    return SimpleNamespace(flange="flange", place=lambda joints: {"flange": mount(joints)})


class Telling:
    """A prediction, and what it has told."""

    def __init__(self, way: int = 0, camera_fits: Callable[[], bool] = lambda: True) -> None:
        self.sides, self.told = Sides(way, way), list[MountPrediction]()
        figure = figure_of(MODEL.tcp_pose)
        self.present = Present(self.sides.model, figure, self.told.append, camera_fits)

    def send(self, now_ns: int) -> None:
        self.present.sent(self.sides.hand.sample(START_NS, 0.0), now_ns)


LENS = lens_of(64, 48)
FRAME = picture(LENS, THEN)


def show(trail: MountTrail, age_ms: float = 120.0, now_ns: int | None = None):
    now_ns = last_ns() if now_ns is None else now_ns
    age_ns = round(age_ms * NS_PER_MS)
    view = WristView(WristWarp(LENS, ()), trail)
    return view.show(FRAME, now_ns - age_ns, now_ns)


def test_a_frame_is_shown_as_it_would_look_from_where_the_mount_is_believed_to_be():
    shown = show(trail_of())
    warped = WristWarp(LENS, ()).to_now(FRAME, THEN, NOW)
    assert shown.as_received is None
    assert (shown.image == warped).all()


@pytest.mark.parametrize("offset_ns", [0, 7_000_000_000])
def test_a_frame_that_is_too_old_by_the_clock_it_was_captured_by_is_shown_as_received(offset_ns):
    trail, end_ns = trail_of(late_ns=0, steps=120, offset_ns=offset_ns), last_ns(120)
    view = WristView(WristWarp(LENS, ()), trail)
    assert view.show(FRAME, end_ns + offset_ns - OLDEST_NS, end_ns).as_received is None
    old = view.show(FRAME, end_ns + offset_ns - OLDEST_NS - 1, end_ns)
    assert old.as_received is AsReceived.OLD
    assert old.image is FRAME


def test_a_frame_is_shown_as_received_while_predictions_are_wrong():
    assert show(trail_of(trusted=True)).as_received is None
    assert show(trail_of(trusted=False)).as_received is AsReceived.UNSURE


def test_a_frame_is_shown_as_received_where_the_camera_is_not_as_calibrated():
    trail = MountTrail()
    for step in range(40):
        now_ns, fits = START_NS + step * PERIOD_NS, step < 20
        trail.add(placed(now_ns, THEN, NOW, 100 * NS_PER_MS, camera_fits=fits))
    assert show(trail, now_ns=START_NS + 10 * PERIOD_NS).as_received is None
    assert show(trail).as_received is AsReceived.MISFIT


def test_each_belief_says_whether_the_camera_is_as_calibrated():
    fits = iter((True, False))
    telling = Telling(camera_fits=lambda: next(fits))
    telling.present.heard(state(START_NS, READY_JOINTS), way_ns=0)
    for step in (2, 4):
        telling.send(START_NS + step * PERIOD_NS)
    assert [one.camera_fits for one in telling.told] == [True, False]


def test_a_frame_is_shown_as_received_where_the_mount_is_not_known():
    assert show(MountTrail()).as_received is AsReceived.UNKNOWN
    late = trail_of(late_ns=200 * NS_PER_MS)
    assert show(late, age_ms=160.0).as_received is None  # 40 ms after the newest state
    assert show(late, age_ms=140.0).as_received is AsReceived.UNKNOWN
    assert show(trail_of(), 120.0, last_ns() + 40 * NS_PER_MS).as_received is None
    silent = show(trail_of(), 120.0, last_ns() + 60 * NS_PER_MS)
    assert silent.as_received is AsReceived.UNKNOWN
    before = show(trail_of(), 450.0)
    assert before.as_received is AsReceived.UNKNOWN


def test_a_frame_is_shown_as_received_where_the_camera_sees_the_horizon():
    tilted = above(0.0, 0.0, 0.2, Rotation.from_rotvec((1.2, 0.0, 0.0)))
    assert show(trail_of(tilted)).as_received is AsReceived.HORIZON


def test_a_tool_that_points_down_turns_smoothly_between_two_samples():
    """There the quaternion's scalar part changes its sign, and with it all of them might."""
    trail = MountTrail()
    for step, angle in enumerate((math.pi - 0.05, math.pi + 0.05)):
        pose = Pose(np.zeros(3), Rotation.from_rotvec((angle, 0.0, 0.0)))
        pose = Pose(pose.position, Rotation.from_rotvec(pose.rotation.as_rotvec()))
        trail.add(placed(step * 1000, pose, pose))
    between = trail.then(500).mount
    assert abs(between.rotation.magnitude()) == pytest.approx(math.pi, abs=1e-3)
    assert between.rotation.apply((0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, -1.0), abs=1e-3)


def test_where_the_mount_was_believed_to_be_is_remembered():
    trail = MountTrail()
    for step in range(100):
        pose = Pose(np.array([step, 0.0, 0.0]), Rotation.identity())
        trail.add(placed(step * PERIOD_NS, pose, pose))
    assert trail.now(40 * PERIOD_NS).arm.mount.position[0] == pytest.approx(40)
    assert trail.then(40 * PERIOD_NS).mount.position[0] == pytest.approx(40)


def test_between_two_beliefs_the_last_motion_goes_on_for_a_moment():
    trail = MountTrail()
    for step in (0, 1):
        pose = Pose(np.array([0.1 * step, 0.0, 0.0]), Rotation.identity())
        trail.add(placed(step * 16 * NS_PER_MS, pose, pose))
    ahead = [trail.now((16 + later) * NS_PER_MS).arm.mount.position[0] for later in (0, 8, 40)]
    assert ahead == pytest.approx([0.1, 0.15, 0.225])


def test_each_second_sample_tells_where_the_mount_is_then_and_now():
    telling = Telling(way=6)
    sides, told = telling.sides, telling.told
    sides.model = telling.present  # type: ignore[assignment]  # it takes the same samples and states
    sides.engage()
    sides.hand.linear = hand_for((0.1, 0.0, 0.0), sides.config)
    for _ in range(60):
        sides.step()
        last = told[-1]
        assert last.now_ns >= sides.now_ns - PERIOD_NS
        assert last.then_ns == last.now_ns - 7 * PERIOD_NS  # the state comes after the sample
        true = MODEL.tcp_pose(sides.arm.joints).position
        assert np.linalg.norm(last.now.position - true) < 2e-3
        assert (MODEL.tcp_pose(last.now_joints).position == last.now.position).all()
        assert (MODEL.tcp_pose(last.then_joints).position == last.then.position).all()
    assert np.linalg.norm(last.then.position - true) > 4e-3
    assert [one.now_ns for one in told[-3:]] == [
        told[-1].now_ns - number * 2 * PERIOD_NS for number in (2, 1, 0)
    ]


def test_frames_may_be_captured_by_another_clock():
    telling, trail = Telling(), MountTrail()
    telling.present.heard(state(START_NS, READY_JOINTS), way_ns=0, offset_ns=5_000_000_000)
    telling.send(START_NS + PERIOD_NS)
    (told,) = telling.told
    assert (told.now_ns, told.then_ns) == (START_NS + PERIOD_NS, START_NS + 5_000_000_000)
    trail.add(told)
    assert trail.offset_ns == 5_000_000_000


def test_nothing_is_told_before_the_first_state_and_an_older_one_than_the_last_moves_nothing():
    """Else a clock that was misjudged would leave an old prediction beside new places."""
    telling = Telling()
    telling.send(START_NS)
    assert telling.told == []
    for t_ns in (START_NS, START_NS - PERIOD_NS):
        joints = READY_JOINTS + (START_NS - t_ns) * 1e-9
        telling.present.heard(state(t_ns, joints), way_ns=0)
    telling.send(START_NS + 2 * PERIOD_NS)
    assert telling.told[-1].then_ns == START_NS
    assert telling.told[-1].then.position == pytest.approx(MODEL.tcp_pose(READY_JOINTS).position)


def test_the_luma_of_what_is_shown_is_that_of_the_picture():
    view = WristView(WristWarp(LENS, ()), trail_of())
    age_ns = 120 * NS_PER_MS
    grey = view.luma(FRAME[..., 0], last_ns() - age_ns, last_ns())
    assert (grey == show(trail_of()).image[..., 0]).all()


def test_a_description_has_the_tool_and_survives_its_way_to_another_process():
    part = Solid(SolidKind.CYLINDER, above(0.0, 0.05, 0.06), (0.02, 0.02, 0.03), (1.0, 0.0, 0.0))
    camera = PredictedCamera(LENS, (part,))
    content = msgspec.json.encode(camera, enc_hook=numbers_of)
    received = msgspec.json.decode(content, type=PredictedCamera, dec_hook=array_of)
    age_ns = 120 * NS_PER_MS
    frame = FRAME.copy()
    shown = received.view(trail_of()).show(frame, last_ns() - age_ns, last_ns())
    expected = WristWarp(LENS, (part,)).to_now(frame, THEN, NOW)
    assert (shown.image == expected).all()
    assert (shown.image != show(trail_of()).image).any()


def test_a_prediction_that_fails_is_told_once_and_holds_up_neither_hand_nor_states():
    failures: list[Exception] = []

    def broken(_joints):
        raise RuntimeError("no such pose")

    sides = Sides(way=6, back=6)
    present = Present(sides.model, figure_of(broken), lambda _: None, lambda: True)
    present.on_failure = failures.append
    sides.model = present  # type: ignore[assignment]  # it takes the same samples and states
    sides.engage()
    for _ in range(20):
        sides.step()
    assert [str(one) for one in failures] == ["no such pose"]
