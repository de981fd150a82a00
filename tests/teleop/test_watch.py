from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tams_app.records import (
    Activity,
    ArmFault,
    ArmState,
    CommandLink,
    ControllerSample,
    ControllerStatus,
    LinkFault,
    Pose,
    ServoMode,
)
from tams_app.rotation import Rotation
from tams_app.teleop.records import TeleopInput
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.teleop.watch import Watch
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.teleop.rig import make_config

pytestmark = pytest.mark.waiting

NOW = 10 * NS_PER_S
MS = NS_PER_MS
POSE = Pose(np.zeros(3), Rotation.identity())
SAMPLE = ControllerSample.released(ControllerStatus.OK, POSE, NOW, NOW)
ARM = ArmState(NOW, np.zeros(6), POSE, Activity.IDLE, ServoMode.VELOCITY, None, None)
LINK = CommandLink(0, NOW, MS, 0, "")
FINE = TeleopInput(NOW, SAMPLE, ARM, LINK, True, 0, False, False)
WATCH = Watch(make_config(), 0)
HALTED = (Activity.PAUSED, Activity.STOPPED)
ENGAGED, READY, DISARMED = ArmingState.ENGAGED, ArmingState.READY, ArmingState.DISARMED


def with_sample(**changes: object) -> TeleopInput:
    return replace(FINE, sample=replace(SAMPLE, **changes))  # type: ignore[arg-type]


def with_arm(**changes: object) -> TeleopInput:
    return replace(FINE, arm=replace(ARM, **changes))  # type: ignore[arg-type]


def with_link(**changes: object) -> TeleopInput:
    return replace(FINE, link=replace(LINK, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("state", list(ArmingState))
def test_a_fine_tick_has_neither_faults_nor_holds(state: ArmingState) -> None:
    assert WATCH.faults(FINE, state) == []
    assert WATCH.holds(FINE, state) == []


NAN_POSE = Pose(np.array([0, np.nan, 0]), Rotation.identity())
FAR_POSE = Pose(np.array([0, 0, -100.1]), Rotation.identity())  # 1e300 would overflow


@pytest.mark.parametrize(
    ("tick", "holds"),
    [
        (with_sample(status=ControllerStatus.TRACKING_LOST), Reason.TRACKING_LOST),
        (with_sample(pose=None), Reason.TRACKING_LOST),
        (with_sample(status=ControllerStatus.STANDBY), Reason.CONTROLLER_STANDBY),
        (with_sample(status=ControllerStatus.DASHBOARD), Reason.DASHBOARD_OPEN),
        (with_sample(pose=NAN_POSE), Reason.BAD_INPUT),
        (with_sample(trigger=float("nan")), Reason.BAD_INPUT),
        (with_sample(grip=float("inf")), Reason.BAD_INPUT),
        (with_sample(pose_ns=NOW + NS_PER_S), Reason.BAD_INPUT),
        (with_sample(pose=FAR_POSE), Reason.BAD_INPUT),
        (with_sample(buttons_ns=NOW - 101 * MS), Reason.BUTTONS_STALE),
        (replace(FINE, arm=None), Reason.ARM_STATE_STALE),
        (with_arm(received_ns=NOW - 101 * MS), Reason.ARM_STATE_STALE),
        (with_arm(received_ns=NOW - NS_PER_S), Reason.ARM_STATE_STALE),  # not yet silent
        (with_arm(joints=np.full(6, np.inf)), Reason.ARM_STATE_INVALID),
        (with_arm(tcp=NAN_POSE), Reason.ARM_STATE_INVALID),
        (with_arm(tcp=FAR_POSE), Reason.ARM_STATE_INVALID),
        (with_arm(joints=np.full(6, -101.0)), Reason.ARM_STATE_INVALID),
        (with_link(acknowledged_ns=NOW - 101 * MS), Reason.ARM_REPLY_LATE),
        (with_link(round_trip_ns=101 * MS), Reason.ARM_REPLY_LATE),
        (replace(FINE, video_age_ns=1000 * MS), Reason.STALE_VIDEO),
        (replace(FINE, video_age_ns=-51 * MS), Reason.STALE_VIDEO),  # from the future
        (replace(FINE, video_age_ns=1000 * MS, video_damaged=True), Reason.VIDEO_DAMAGED),
        (replace(FINE, arm_ready=False), Reason.ARM_NOT_READY),
        (replace(FINE, faults=(Reason.STALE_VIDEO,)), Reason.STALE_VIDEO),
    ],
)
def test_what_is_stale_holds(tick: TeleopInput, holds: Reason) -> None:
    assert WATCH.holds(tick, ENGAGED) == [holds]
    assert WATCH.faults(tick, ENGAGED) == []


@pytest.mark.parametrize(
    "tick",
    [
        with_sample(buttons_ns=NOW - 100 * MS),
        with_sample(pose_ns=NOW - 99 * MS),
        with_sample(pose=Pose(np.array([100.0, 0, -100]), Rotation.identity())),
        with_arm(received_ns=NOW + 50 * MS),
        with_arm(received_ns=NOW - 100 * MS),
        with_link(acknowledged_ns=NOW - 100 * MS, round_trip_ns=100 * MS),
        replace(FINE, video_age_ns=999 * MS),
        replace(FINE, video_age_ns=-50 * MS),
        replace(FINE, video_age_ns=None),
    ],
)
def test_what_is_just_fresh_enough_does_not_hold(tick: TeleopInput) -> None:
    assert WATCH.holds(tick, ENGAGED) == []
    assert WATCH.faults(tick, ENGAGED) == []


@pytest.mark.parametrize(
    ("tick", "fault"),
    [
        (with_sample(status=ControllerStatus.DISCONNECTED), Reason.CONTROLLER_DISCONNECTED),
        (with_sample(status=ControllerStatus.RUNTIME_QUIT), Reason.RUNTIME_QUIT),
        (with_arm(fault=ArmFault(24, "C24")), Reason.ARM_ERROR),
        (with_arm(received_ns=NOW - NS_PER_S - 1), Reason.ARM_SILENT),
        (with_sample(status=ControllerStatus.ROLE_SWAPPED), Reason.ROLE_SWAPPED),
        (
            with_sample(status=ControllerStatus.TRACKING_FRAME_CHANGED),
            Reason.TRACKING_FRAME_CHANGED,
        ),
        (with_link(failure="The arm closed the connection."), Reason.ARM_LINK_LOST),
        (with_link(failure="It is gone.", fault=LinkFault.LOST), Reason.ARM_LINK_LOST),
        (with_link(failure="It said no.", fault=LinkFault.REFUSED), Reason.ARM_REFUSES),
        (with_link(failure="It stays open.", fault=LinkFault.GRIPPER), Reason.GRIPPER_FAILED),
        (replace(FINE, faults=(Reason.GUARD_STOPPED,)), Reason.GUARD_STOPPED),
        (replace(FINE, faults=(Reason.SESSION_FAILED,)), Reason.SESSION_FAILED),
    ],
)
@pytest.mark.parametrize("state", list(ArmingState))
def test_errors_and_lost_devices_are_faults_in_any_state(
    tick: TeleopInput, fault: Reason, state: ArmingState
) -> None:
    assert WATCH.faults(tick, state) == [fault]


@pytest.mark.parametrize(
    ("tick", "fault"),
    [
        *((with_arm(activity=halted), Reason.ARM_STOPPED) for halted in HALTED),
        *((with_arm(servo=servo), Reason.ARM_MODE) for servo in (None, ServoMode.POSE)),
    ],
)
def test_an_arm_that_left_the_servo_is_a_fault_only_while_armed(
    tick: TeleopInput, fault: Reason
) -> None:
    assert not WATCH.servo_ready(tick.arm)
    for state in ArmingState:
        assert WATCH.faults(tick, state) == ([fault] if state.is_armed else [])


def test_a_frozen_pose_is_a_fault_while_engaged_and_forbids_engaging() -> None:
    frozen = with_sample(pose_ns=NOW - 100 * MS)
    assert WATCH.faults(frozen, ENGAGED) == [Reason.POSE_FROZEN]
    assert WATCH.faults(frozen, READY) == []
    assert WATCH.holds(frozen, READY) == [Reason.POSE_FROZEN]
    lost = with_sample(pose_ns=NOW - 100 * MS, status=ControllerStatus.TRACKING_LOST)
    assert WATCH.faults(lost, ENGAGED) == []


@pytest.mark.parametrize(
    ("status", "fault"),
    [
        (ControllerStatus.LINK_LOST, Reason.LINK_LOST),
        (ControllerStatus.OPERATOR_AWAY, Reason.OPERATOR_LEFT),
    ],
)
@pytest.mark.parametrize("state", list(ArmingState))
def test_an_operator_who_is_not_there_is_a_fault_but_of_an_arm_that_none_has_armed(
    status: ControllerStatus, fault: Reason, state: ArmingState
) -> None:
    tick = with_sample(status=status, pose=None, pose_ns=0, buttons_ns=0)
    away = state is DISARMED
    assert WATCH.faults(tick, state) == ([] if away else [fault])
    assert (Reason.NO_OPERATOR in WATCH.holds(tick, state)) == away


@pytest.mark.parametrize("state", list(ArmingState))
def test_a_gap_in_the_link_is_a_hold_in_any_state(state: ArmingState) -> None:
    tick = with_sample(status=ControllerStatus.LINK_GAP, pose=None, pose_ns=0, buttons_ns=0)
    assert WATCH.faults(tick, state) == []
    assert Reason.LINK_GAP in WATCH.holds(tick, state)


def test_disarmed_the_link_the_video_and_the_arms_mode_are_not_judged() -> None:
    tick = replace(
        FINE, arm_ready=False, video_age_ns=NS_PER_S * 9, link=replace(LINK, acknowledged_ns=0)
    )
    assert WATCH.holds(tick, DISARMED) == []


def test_the_frame_slows_the_arm_and_then_holds_it() -> None:
    ages_ms = (None, 0, 499, 500, 750, 900, 1000, 5000)
    scales = [WATCH.video_scale(None if age is None else age * MS) for age in ages_ms]
    assert scales == pytest.approx([1, 1, 1, 1, 0.5, 0.2, 0, 0])


@pytest.mark.parametrize(("floor_ms", "slow_ms", "hold_ms"), [(300, 900, 1000), (500, 1500, 1500)])
def test_the_video_limits_are_never_below_three_times_the_latency(
    floor_ms: int, slow_ms: int, hold_ms: int
) -> None:
    watch = Watch(make_config(), floor_ms * MS)
    assert watch.video_scale(slow_ms * MS - 1) == 1.0
    assert watch.video_scale(hold_ms * MS) == 0.0
    assert watch.video_scale(hold_ms * MS - MS) > 0.0


def test_every_status_of_the_controller_but_ok_is_a_fault_or_a_hold() -> None:
    for status in ControllerStatus:
        tick = with_sample(status=status)
        found = WATCH.faults(tick, ENGAGED) + WATCH.holds(tick, ENGAGED)
        assert len(found) == (status is not ControllerStatus.OK), status


def test_every_kind_of_link_failure_has_a_reason_of_its_own() -> None:
    kinds = [kind for kind in LinkFault if kind is not LinkFault.NONE]
    found = [WATCH.faults(with_link(failure="Why.", fault=kind), READY) for kind in kinds]
    assert [len(reasons) for reasons in found] == [1] * len(kinds)
    assert len({reasons[0] for reasons in found}) == len(kinds)


def test_a_lost_controller_is_not_told_twice() -> None:
    tick = with_sample(status=ControllerStatus.DISCONNECTED, pose=None, buttons_ns=0, pose_ns=0)
    assert WATCH.faults(tick, ENGAGED) == [Reason.CONTROLLER_DISCONNECTED]
    assert WATCH.holds(tick, ENGAGED) == []
