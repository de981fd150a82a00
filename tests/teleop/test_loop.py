"""What the operator and the session see of a whole tick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tams_app.records import (
    Activity,
    ArmFault,
    CommandLink,
    ControllerStatus,
    Haptic,
    LinkFault,
    ServoMode,
)
from tams_app.teleop.records import Refusal
from tams_app.teleop.safety import ArmingState, Reason, Request
from tests.teleop.rig import PERIOD_NS, Bench, make_config

pytestmark = pytest.mark.waiting

DISARMED, READY, ENGAGED, HOLDING, FAULT = ArmingState
MS = 1_000_000

COLLISION = ArmFault(31, "C31 (collision): remove what it hit")
SELF_COLLISION = ArmFault(22, "C22 (self-collision): move the arm clear")


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def engaged(bench: Bench) -> Bench:
    bench.engage()
    return bench


def link(bench: Bench, **changes: object) -> CommandLink:
    fine = CommandLink(0, bench.now_ns + PERIOD_NS, MS, 0, "")
    return replace(fine, **changes)  # type: ignore[arg-type]


# --- arming ---------------------------------------------------------------------------------------


def test_disarmed_sends_nothing_and_asks_to_enable_when_confirmed(bench: Bench) -> None:
    first = bench.tick()
    assert (first.twist, first.stop) == (None, False)
    assert bench.tick(confirm=True).request is Request.ENABLE
    waiting = bench.run(50)
    assert (waiting.arming, waiting.twist, waiting.request) == (DISARMED, None, Request.NONE)
    bench.arm_ready = True
    ready = bench.tick()
    assert ready.arming is READY
    assert ready.twist is not None
    assert ready.twist.is_zero


@pytest.mark.parametrize("confirm", [False, True])
def test_the_first_tick_has_nothing_of_a_motion_even_if_it_gets_ready(
    bench: Bench, confirm: bool
) -> None:
    bench.arm_ready = True
    first = bench.tick(confirm=confirm)
    assert first.arming is (READY if confirm else DISARMED)
    assert (first.orientation_mode, first.speed_scale, first.braking) == (False, 1.0, False)


@pytest.mark.parametrize(("age_ns", "held"), [(100 * MS, True), (100 * MS + 1, False)])
def test_a_trigger_is_held_as_long_as_the_buttons_are_fresh(
    engaged: Bench, age_ns: int, held: bool
) -> None:
    now_ns = engaged.now_ns + PERIOD_NS
    sample = engaged.hand.sample(now_ns, 0.0)
    assert engaged.tick(sample=replace(sample, buttons_ns=now_ns - age_ns)).deadman is held


def test_an_arm_in_the_wrong_mode_does_not_get_ready(bench: Bench) -> None:
    bench.arm.servo = None
    bench.arm_ready = True
    bench.tick()
    assert bench.tick(confirm=True).arming is DISARMED
    bench.arm.servo = ServoMode.VELOCITY
    assert bench.tick().arming is READY


def test_a_trigger_held_from_the_start_neither_arms_nor_engages(bench: Bench) -> None:
    bench.hand.trigger = 1.0
    bench.arm_ready = True
    bench.run(3)
    assert bench.tick(confirm=True).arming is DISARMED
    bench.hand.trigger = 0.0
    bench.tick()
    assert bench.tick(confirm=True).arming is READY


def test_ready_and_holding_keep_sending_exact_zeros(engaged: Bench) -> None:
    engaged.hand.trigger = 0.0
    assert all(engaged.tick().twist.is_zero for _ in range(20))  # type: ignore[union-attr]
    engaged.hand.trigger = 1.0
    engaged.tick()
    held = [engaged.tick(video_age_ns=2_000 * MS) for _ in range(20)]
    assert {output.arming for output in held} == {HOLDING}
    assert all(output.twist is not None and output.twist.is_zero for output in held)


@pytest.mark.parametrize("away", [s for s in ControllerStatus if s is not ControllerStatus.OK])
def test_a_controller_that_is_away_stops_the_arm(engaged: Bench, away: ControllerStatus) -> None:
    engaged.ask(0, 0.2, 0)
    engaged.run(40)
    engaged.hand.status = away
    output = engaged.tick()
    assert output.arming in (HOLDING, FAULT)
    assert output.reason is not None
    assert not output.deadman
    engaged.run(13)
    assert not engaged.linear()[-1].any()
    engaged.hand.status = ControllerStatus.OK
    assert engaged.run(20).arming is output.arming  # the trigger is still held
    engaged.hand.trigger = 0.0
    engaged.run(2)
    assert engaged.outputs[-1].arming is (READY if output.arming is HOLDING else FAULT)


def test_a_fault_sends_zero_and_stop_at_once_and_stop_until_the_arm_stopped(
    engaged: Bench,
) -> None:
    engaged.ask(0, 0.2, 0)
    engaged.run(40)
    output = engaged.tick(faults=(Reason.GUARD_LOST,))
    assert (output.arming, output.reason, output.stop) == (FAULT, Reason.GUARD_LOST, True)
    assert output.twist is not None
    assert output.twist.is_zero
    assert output.haptic is Haptic.FAULT
    engaged.arm.activity = Activity.MOVING
    reports = [replace(engaged.arm.report(engaged.now_ns), activity=Activity.MOVING)] * 5
    assert all(engaged.tick(arm=report).stop for report in reports)
    after = engaged.tick()  # the arm followed state 4
    assert engaged.arm.activity is Activity.STOPPED
    assert (after.stop, after.twist) == (False, None)


def test_an_arm_without_reports_is_told_to_stop_again_and_again(engaged: Bench) -> None:
    engaged.tick(estop=True, arm=None)
    assert all(engaged.tick(arm=None).stop for _ in range(300))


def test_an_arm_that_only_paused_has_not_stopped(engaged: Bench) -> None:
    engaged.tick(estop=True)
    for activity, stops in ((Activity.PAUSED, True), (Activity.STOPPED, False)):
        report = engaged.arm.report(engaged.now_ns + PERIOD_NS)
        assert engaged.tick(arm=replace(report, activity=activity)).stop is stops


def test_a_report_from_before_the_fault_does_not_confirm_the_stop(engaged: Bench) -> None:
    old = replace(engaged.arm.report(engaged.now_ns), activity=Activity.STOPPED)
    engaged.tick(estop=True)
    assert engaged.tick(arm=old).stop
    fault_ns = engaged.times_ns[-2]
    assert engaged.tick(arm=replace(old, received_ns=fault_ns)).stop
    assert not engaged.tick(arm=replace(old, received_ns=fault_ns + 1)).stop


def test_leaving_a_fault_takes_a_confirmation_with_the_trigger_up(engaged: Bench) -> None:
    engaged.arm.fault = COLLISION
    output = engaged.tick()
    assert (output.reason, output.detail) == (Reason.ARM_ERROR, COLLISION.text)
    assert engaged.tick(confirm=True).request is Request.NONE
    engaged.hand.trigger = 0.0
    engaged.tick()
    assert engaged.tick(confirm=True).request is Request.CLEAR_ERRORS
    assert engaged.tick().arming is FAULT
    engaged.arm.fault = None
    output = engaged.tick()
    assert (output.arming, output.twist, output.stop) == (DISARMED, None, False)
    assert engaged.run(100).arming is DISARMED


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (LinkFault.NONE, Reason.ARM_LINK_LOST),
        (LinkFault.REFUSED, Reason.ARM_REFUSES),
        (LinkFault.GRIPPER, Reason.GRIPPER_FAILED),
    ],
)
def test_a_failed_link_is_confirmed_away_once_it_works_again(
    engaged: Bench, fault: LinkFault, reason: Reason
) -> None:
    broken = link(engaged, failure="It said no.", fault=fault)
    output = engaged.tick(link=broken)
    assert (output.reason, output.detail, output.stop) == (reason, "It said no.", True)
    engaged.hand.trigger = 0.0
    engaged.tick(link=broken)
    assert engaged.tick(link=broken, confirm=True).request is Request.CLEAR_ERRORS
    assert engaged.tick(link=broken).arming is FAULT
    assert engaged.tick().arming is DISARMED


def test_an_arm_that_stopped_by_an_error_says_which(engaged: Bench) -> None:
    engaged.arm.activity = Activity.STOPPED
    assert engaged.tick().detail == ""
    engaged.arm.fault = SELF_COLLISION
    output = engaged.tick()
    assert (output.reason, output.detail) == (Reason.ARM_STOPPED, SELF_COLLISION.text)


def test_a_fault_names_what_else_is_in_the_way_of_confirming_it(engaged: Bench) -> None:
    engaged.arm.fault = COLLISION
    engaged.tick()
    engaged.hand.status = ControllerStatus.DISCONNECTED
    output = engaged.tick()
    assert output.reason is Reason.ARM_ERROR
    assert output.detail == f"{COLLISION.text}, and controller disconnected"
    engaged.hand.status = ControllerStatus.OK
    assert engaged.tick().detail == COLLISION.text
    engaged.arm.fault = None
    engaged.hand.status = ControllerStatus.ROLE_SWAPPED
    assert engaged.tick().detail == "and controller swapped"


def test_what_the_link_says_is_no_detail_of_another_reason(engaged: Bench) -> None:
    engaged.tick(estop=True)
    output = engaged.tick(link=link(engaged, failure="It is gone."))
    assert (output.reason, output.detail) == (Reason.EMERGENCY_STOP, "")


def test_what_the_link_says_goes_on_with_what_else_is_in_the_way(engaged: Bench) -> None:
    engaged.tick(link=link(engaged, failure="It is gone."))
    engaged.hand.status = ControllerStatus.DISCONNECTED
    output = engaged.tick(link=link(engaged, failure="It is gone."))
    assert output.detail == "It is gone, and controller disconnected"


def test_what_of_a_stop_is_still_there_is_told_until_it_is_gone(engaged: Bench) -> None:
    lost, gone = Reason.TRACKING_LOST, Reason.CONTROLLER_DISCONNECTED
    for status, arming, reason, lasting in (
        (ControllerStatus.TRACKING_LOST, HOLDING, lost, lost),
        (ControllerStatus.OK, HOLDING, lost, None),
        (ControllerStatus.DISCONNECTED, FAULT, gone, gone),
        (ControllerStatus.ROLE_SWAPPED, FAULT, gone, Reason.ROLE_SWAPPED),  # in the way now
        (ControllerStatus.OK, FAULT, gone, None),
    ):
        engaged.hand.status = status
        output = engaged.tick()
        assert (output.arming, output.reason, output.lasting) == (arming, reason, lasting)


def test_a_confirmation_that_does_not_count_is_told_what_is_in_the_way(bench: Bench) -> None:
    bench.run(3)
    bench.hand.trigger = 1.0
    held = bench.tick(confirm=True)
    assert (held.arming, held.refusal) == (DISARMED, Refusal(None))
    bench.hand.trigger = 0.0
    bench.hand.status = ControllerStatus.STANDBY
    stale = bench.tick(confirm=True)
    assert stale.refusal == Refusal(Reason.CONTROLLER_STANDBY)
    bench.hand.status = ControllerStatus.OK
    bench.run(2)
    lost = (Reason.GUARD_BLIND,)
    bench.tick(faults=lost)
    refused = bench.tick(faults=lost, confirm=True)
    assert refused.refusal == Refusal(Reason.GUARD_BLIND)
    assert bench.tick(faults=lost).refusal is None, "told once"
    bench.hand.trigger = 1.0
    bench.run(2)
    assert bench.tick(confirm=True).refusal == Refusal(None)


def test_a_confirmation_that_counts_is_told_nothing(bench: Bench) -> None:
    bench.run(3)
    assert bench.tick(confirm=True).refusal is None
    bench.arm_ready = True
    bench.tick()
    ready = bench.tick(confirm=True)
    assert (ready.arming, ready.refusal) == (READY, None), "nothing to confirm"
    bench.tick(estop=True)
    assert bench.tick(confirm=True).refusal is None


def test_a_fault_that_still_holds_is_not_named_twice(engaged: Bench) -> None:
    engaged.hand.status = ControllerStatus.RUNTIME_QUIT
    assert engaged.run(3).detail == ""


@pytest.mark.parametrize(
    "away",
    [
        ControllerStatus.DISCONNECTED,
        ControllerStatus.RUNTIME_QUIT,
        ControllerStatus.ROLE_SWAPPED,
        ControllerStatus.TRACKING_FRAME_CHANGED,
    ],
)
def test_a_controller_switched_on_after_the_start_takes_two_confirmations_to_ready(
    bench: Bench, away: ControllerStatus
) -> None:
    bench.hand.status = away
    bench.hand.trigger = 1.0
    bench.arm_ready = True
    assert bench.run(3).arming is FAULT
    assert bench.tick(confirm=True).arming is FAULT
    bench.hand.status = ControllerStatus.OK
    bench.hand.trigger = 0.0
    bench.arm.activity = Activity.IDLE  # enabled again after the stop
    assert bench.run(3).arming is FAULT  # the confirmation before it was back counts nothing
    assert bench.tick(confirm=True).arming is DISARMED
    assert bench.run(3).arming is DISARMED
    assert bench.tick(confirm=True).arming is READY


# --- emergency stop and menu ----------------------------------------------------------------------


def test_the_terminals_emergency_stop_works_in_every_state(bench: Bench) -> None:
    bench.tick()
    output = bench.tick(estop=True, confirm=True, faults=(Reason.SESSION_FAILED,))
    assert output.reason is Reason.EMERGENCY_STOP


@pytest.mark.parametrize("engage", [False, True])
def test_pressing_the_menu_while_armed_stops_at_once_and_never_confirms(
    bench: Bench, engage: bool
) -> None:
    bench.make_ready()
    if engage:
        bench.engage()
    bench.hand.menu = True
    output = bench.tick()
    assert (output.arming, output.reason, output.stop) == (FAULT, Reason.EMERGENCY_STOP, True)
    bench.hand.trigger = 0.0
    assert bench.run(300).arming is FAULT
    bench.hand.menu = False
    assert bench.run(5).arming is FAULT


def test_the_menu_held_for_a_second_confirms_a_fault_and_then_arms(bench: Bench) -> None:
    bench.make_ready()
    bench.tick(estop=True)
    bench.hand.menu = True
    assert bench.run(119).arming is FAULT
    assert bench.run(3).arming is DISARMED
    assert bench.run(300).arming is DISARMED  # one hold is one confirmation
    bench.hand.menu = False
    bench.arm.activity = Activity.IDLE
    bench.run(2)
    bench.hand.menu = True
    assert bench.run(123).arming is READY


def test_a_menu_click_while_disarmed_is_an_emergency_stop(bench: Bench) -> None:
    bench.run(2)
    bench.hand.menu = True
    assert bench.run(20).arming is DISARMED
    bench.hand.menu = False
    assert bench.tick().reason is Reason.EMERGENCY_STOP


# --- gripper and haptics --------------------------------------------------------------------------


def test_the_gripper_moves_on_edges_while_engaged_only(bench: Bench) -> None:
    bench.hand.a = True
    bench.make_ready()
    bench.hand.a = False
    bench.tick()
    bench.hand.a = True
    bench.run(2)
    bench.hand.trigger = 1.0
    bench.run(5)
    assert all(output.gripper is None for output in bench.outputs)
    bench.hand.a = False
    bench.tick()
    bench.hand.a = True
    assert bench.tick().gripper is True
    assert bench.tick().gripper is None
    bench.hand.b = True
    assert bench.tick().gripper is False


def test_the_hand_feels_what_happens(bench: Bench) -> None:
    bench.make_ready()
    assert bench.engage().haptic is Haptic.ENGAGE
    assert bench.tick().haptic is None
    assert bench.tick(video_age_ns=2_000 * MS).haptic is Haptic.LIMIT
    bench.hand.trigger = 0.0
    assert bench.tick().haptic is None
    bench.hand.trigger = 1.0
    bench.tick()
    bench.hand.trigger = 0.0
    assert bench.tick().haptic is Haptic.RELEASE


@pytest.mark.parametrize(
    ("status", "haptic"),
    [
        (ControllerStatus.LINK_GAP, Haptic.LINK_HOLD),
        (ControllerStatus.LINK_GAPS, Haptic.LINK_HOLD),
        (ControllerStatus.LINK_LOST, Haptic.LINK_FAULT),
        (ControllerStatus.OPERATOR_AWAY, Haptic.FAULT),
        (ControllerStatus.TRACKING_LOST, Haptic.LIMIT),
    ],
)
def test_the_hand_feels_that_it_was_the_link(
    engaged: Bench, status: ControllerStatus, haptic: Haptic
) -> None:
    engaged.hand.status = status
    assert engaged.tick().haptic is haptic


# --- staleness and limits -------------------------------------------------------------------------


def test_a_pose_that_stops_changing_stops_the_arm_and_then_faults(engaged: Bench) -> None:
    engaged.ask(0, 0.2, 0)
    engaged.run(40)
    frozen = engaged.hand.sample(engaged.now_ns, 0.0)
    outputs = []
    for _ in range(13):
        now_ns = engaged.now_ns + PERIOD_NS
        outputs.append(engaged.tick(sample=replace(frozen, buttons_ns=now_ns)))
    assert outputs[11].arming is ENGAGED
    assert outputs[-1].reason is Reason.POSE_FROZEN


def test_without_a_new_pose_for_70_ms_the_arm_brakes_and_then_follows_the_hand_anew() -> None:
    config = make_config(freshness__hold_pose_ms=50, freshness__pose_frozen_ms=250)
    bench = Bench(config)
    bench.engage()
    bench.ask(0, 0.25, 0)
    bench.run(40)
    assert bench.linear()[-1, 1] == pytest.approx(0.25, rel=0.01)
    frozen = bench.hand.sample(bench.now_ns, 0.0)
    gap = []
    for _ in range(22):  # 183 ms
        now_ns = bench.now_ns + PERIOD_NS
        gap.append(bench.tick(sample=replace(frozen, buttons_ns=now_ns)))
    assert {output.arming for output in gap} == {ENGAGED}
    assert [output.braking for output in gap[:9]] == [False] * 8 + [True]  # from 75 ms on
    assert bench.linear()[-1, 1] == 0.0
    at_rest = bench.arm.pose.position
    bench.run(2)
    assert np.linalg.norm(bench.arm.pose.position - at_rest) < 1e-4  # of the gap's 46 mm
    bench.run(60)
    assert bench.outputs[-1].arming is ENGAGED
    assert bench.linear()[-1, 1] == pytest.approx(0.25, rel=0.01)


def test_a_hand_that_jumps_about_is_a_fault(engaged: Bench) -> None:
    for k in range(8):
        engaged.hand.position = np.array([k % 2, 0.0, 0.0])
        engaged.tick()
    assert engaged.outputs[-1].reason is Reason.HAND_TOO_FAST
    assert not engaged.linear().any()


@pytest.mark.parametrize("turns", [False, True])
def test_an_arm_that_does_not_carry_out_a_motion_is_a_following_error(
    engaged: Bench, turns: bool
) -> None:
    if turns:
        engaged.hand.grip = 1.0
        engaged.tick()
        engaged.ask_turn(0, 0.4, 0)
    else:
        engaged.ask(0, 0.2, 0)
    stuck = engaged.arm.report(engaged.now_ns)
    for _ in range(120):
        if engaged.outputs[-1].arming is not ENGAGED:
            break
        now_ns = engaged.now_ns + PERIOD_NS
        engaged.tick(arm=replace(stuck, received_ns=now_ns))
    assert engaged.outputs[-1].reason is Reason.FOLLOWING_ERROR


@pytest.mark.parametrize("noise_rad", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("fast", "ticks", "slow", "period"),
    [(0.02, 1, 0.0, 1), (0.2, 48, 0.0, 120), (0.3, 42, -0.1, 60), (0.1, 41, -0.1, 50)],
    ids=["steady", "with pauses", "back and forth", "jittery"],
)
def test_a_stuck_wrist_is_noticed_whatever_pauses_the_hand_makes(
    engaged: Bench, fast: float, ticks: int, slow: float, period: int, noise_rad: float
) -> None:
    engaged.hand.grip = 1.0
    engaged.tick()
    stuck = engaged.arm.report(engaged.now_ns)
    for tick in range(15 * 120):
        engaged.ask_turn(0, fast if tick % period < ticks else slow, 0)
        turned = stuck.tcp.rotation.turned((0, noise_rad * (-1) ** tick, 0))
        report = replace(stuck, tcp=replace(stuck.tcp, rotation=turned))
        engaged.tick(arm=replace(report, received_ns=engaged.now_ns + PERIOD_NS))
        if engaged.outputs[-1].arming is not ENGAGED:
            break
    assert engaged.outputs[-1].reason is Reason.FOLLOWING_ERROR


def test_a_stalled_control_loop_holds_and_starts_again_from_zero(engaged: Bench) -> None:
    engaged.ask(0, 0.2, 0)
    engaged.run(60)
    output = engaged.tick(period_ns=101 * MS)
    assert (output.arming, output.reason) == (HOLDING, Reason.CONTROL_STALLED)
    assert output.twist is not None
    assert output.twist.is_zero


def test_an_arm_whose_own_deadman_has_run_out_starts_again_from_zero() -> None:
    bench = Bench(make_config(arm__velocity_deadman_s=0.05))
    bench.engage()
    bench.ask(0, 0.2, 0)
    bench.run(60)
    output = bench.tick(period_ns=51 * MS)
    assert output.twist is not None
    assert output.twist.is_zero


def test_an_old_frame_slows_the_hand_and_shows_it(engaged: Bench) -> None:
    engaged.ask(0, 0.2, 0)
    output = engaged.run(80, video_age_ns=750 * MS)
    assert output.speed_scale == pytest.approx(0.5)
    assert engaged.linear()[-1][1] == pytest.approx(0.1, rel=0.05)
    engaged.tick(video_age_ns=1000 * MS)
    assert engaged.outputs[-1].reason is Reason.STALE_VIDEO


def test_the_video_floor_moves_the_limits() -> None:
    bench = Bench(video_floor_ns=400 * MS)
    bench.engage()
    assert bench.tick(video_age_ns=1199 * MS).speed_scale == 1.0
    assert bench.tick(video_age_ns=1200 * MS).reason is Reason.STALE_VIDEO
