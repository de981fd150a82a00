"""The control loop with the real teleoperation and the in-process arm, under a virtual clock."""

import numpy as np
import pytest

from hw.controller import Controller
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel, IdealPlant
from tams_app.config import load_config
from tams_app.config.devices import CameraConfig
from tams_app.records import (
    Activity,
    ControllerSample,
    ControllerStatus,
    Phase,
    PhaseChange,
    Pose,
    Tick,
)
from tams_app.robot import build
from tams_app.robot.control import LoopDevices, Signals
from tams_app.robot.listener import Listener
from tams_app.robot.video import video_delay_ns
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.teleop.safety import ArmingState, Reason, Request
from tams_app.video.core.repair import repair_rule

pytestmark = pytest.mark.waiting

PERIOD_NS = 1_000_000_000 // 120
CONFIG = load_config()


class HeldController(Controller):
    """A hand whose velocity and buttons the test sets."""

    def __init__(self):
        self.velocity = np.zeros(3)  # tracking frame: y up
        self.trigger = 0.0
        self.a = self.b = False
        self.pulses = []
        self._position = np.array([0.0, 1.0, -0.3])
        self._last_ns = None

    def start(self):
        """Nothing to connect to."""

    def sample(self, now_ns):
        elapsed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        jitter = np.array([1e-6 * (now_ns % 7), 0, 0])  # a living pose is never twice the same
        self._position = self._position + self.velocity * elapsed_s
        pose = Pose(self._position + jitter, Rotation.identity())
        return ControllerSample(
            ControllerStatus.OK, pose, now_ns, now_ns, self.trigger, 0.0, self.a, self.b, False
        )

    def pulse(self, haptic):
        self.pulses.append(haptic)

    def close(self):
        """Nothing to let go of."""


class Bench(Listener):
    """The control loop on a bench: gate, video and listener at the test's disposal."""

    def __init__(self, config=CONFIG):
        self.clock = VirtualClock()
        ready = np.radians(np.array(CONFIG.arm.ready_joints_deg))
        self.arm = InProcessArm(
            CONFIG.arm, self.clock, ControllerModel(IdealPlant(), start_joints=ready)
        )
        self.arm.connect()
        self.hand = HeldController()
        self.signals = Signals()
        self.phases, self.ticks, self.beats = [], [], []
        self.beat = self.beats.append
        self.video_age_ns = 50_000_000
        self.video_damaged = False
        self.ready = False
        network = CONFIG.networks["s2"]
        delay_ns = video_delay_ns(network, repair_rule(network, 300.0))
        devices = LoopDevices(self.hand, self.arm, self, self)
        self.loop = build.control_loop(config, self.clock, devices, delay_ns, self.signals, (self,))

    def age_ns(self, view, now_ns):
        return self.video_age_ns

    def is_damaged(self, view):
        return self.video_damaged

    def before_tick(self, now_ns):
        self.beat(now_ns)

    def receive(self, record):
        if isinstance(record, PhaseChange):
            self.phases.append(record)
        elif isinstance(record, Tick):
            self.ticks.append(record)

    def stop(self):
        self.arm.stop()

    def request(self, request):
        if request is Request.ENABLE:
            self.arm.enable()
            self.ready = True
        elif request is Request.CLEAR_ERRORS:
            self.ready = False
            self.arm.clear_errors()

    def run(self, seconds):
        output = None
        for _ in range(round(seconds * 120)):
            self.clock.advance_ns(PERIOD_NS)
            output = self.loop.tick(self.clock.now_ns())
        return output

    def engage(self):
        self.run(0.2)
        self.signals.confirm(self.clock.now_ns())
        self.run(0.5)
        self.hand.trigger = 1.0
        return self.run(0.1)

    @property
    def position(self):
        return self.arm.state().tcp.position


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.arm.close()


def test_nothing_moves_before_the_operator_confirms(bench):
    bench.hand.trigger = 1.0
    bench.hand.velocity = np.array([0.0, 0.0, -0.1])
    start = bench.position
    assert bench.run(1.0).arming is ArmingState.DISARMED
    assert np.linalg.norm(bench.position - start) < 1e-6


def test_the_arm_follows_the_hand_in_the_mapped_direction_while_the_trigger_is_held(bench):
    assert bench.engage().arming is ArmingState.ENGAGED
    start = bench.position
    bench.hand.velocity = np.array([0.0, -0.05, 0.0])  # down in the tracking frame
    bench.run(1.0)
    moved = bench.position - start
    assert moved[2] == pytest.approx(-0.05, abs=0.01)
    assert np.abs(moved[:2]).max() < 0.002


def test_releasing_the_trigger_stops_the_arm_within_a_tenth_of_a_second(bench):
    bench.engage()
    bench.hand.velocity = np.array([0.0, -0.05, 0.0])
    bench.run(0.5)
    bench.hand.trigger = 0.0
    bench.run(0.2)
    rest = bench.position
    bench.run(0.5)
    assert np.linalg.norm(bench.position - rest) < 1e-5
    assert bench.ticks[-1].twist.is_zero


def test_buttons_close_and_open_the_gripper_and_the_phase_follows(bench):
    bench.engage()
    bench.hand.a = True
    bench.run(0.3)
    assert bench.arm.state().gripper_closed is True
    bench.hand.a, bench.hand.b = False, True
    bench.run(0.3)
    assert bench.arm.state().gripper_closed is False
    assert [change.phase for change in bench.phases][-2:] == [Phase.GRASP, Phase.RELEASE]


def test_a_sustained_descent_is_an_alignment(bench):
    bench.engage()
    bench.hand.velocity = np.array([0.0, -0.05, 0.0])
    bench.run(1.5)
    assert bench.ticks[-1].phase is Phase.ALIGN


@pytest.mark.parametrize("rig", [False, True], ids=["real cameras", "the rig's own"])
def test_the_latency_of_a_real_camera_counts_towards_the_age_of_the_video(rig):
    slow = CameraConfig(source="pattern", latency_ms=400.0)
    cameras = dict.fromkeys(CONFIG.video.views, slow)
    enabled = CONFIG.rig.model_copy(update={"enabled": rig})
    bench = Bench(CONFIG.model_copy(update={"rig": enabled, "cameras": cameras}))
    bench.engage()
    bench.video_age_ns = 700_000_000
    expected = ArmingState.ENGAGED if rig else ArmingState.HOLDING
    assert bench.run(0.1).arming is expected
    bench.arm.close()


def test_where_newer_frames_are_shown_that_are_not_whole_the_reason_says_so(bench):
    bench.engage()
    bench.video_damaged = True
    assert bench.run(0.5).arming is ArmingState.ENGAGED, "the age decides"
    bench.video_age_ns = 2_000_000_000
    assert bench.run(0.5).arming is ArmingState.HOLDING
    assert bench.ticks[-1].reason == Reason.VIDEO_DAMAGED.label
    assert bench.ticks[-1].inputs.video_damaged


def test_stale_video_holds_the_arm_until_the_trigger_was_released(bench):
    bench.engage()
    bench.hand.velocity = np.array([0.0, -0.05, 0.0])
    bench.video_age_ns = 2_000_000_000
    assert bench.run(0.5).arming is ArmingState.HOLDING
    assert bench.ticks[-1].reason == Reason.STALE_VIDEO.label
    held = bench.position
    bench.video_age_ns = 50_000_000
    assert bench.run(0.5).arming is ArmingState.HOLDING
    assert np.linalg.norm(bench.position - held) < 1e-4
    bench.hand.trigger = 0.0
    assert bench.run(0.1).arming is ArmingState.READY


def test_an_emergency_stop_latches_and_stops_the_controller_itself(bench):
    bench.engage()
    bench.signals.estop()
    assert bench.run(0.2).arming is ArmingState.FAULT
    assert bench.arm.state().activity is Activity.STOPPED
    bench.hand.trigger = 0.0
    bench.run(0.2)
    bench.signals.confirm(bench.clock.now_ns())
    assert bench.run(0.5).arming is ArmingState.DISARMED


def test_a_lost_guard_is_a_fault_that_cannot_be_confirmed_away(bench):
    bench.engage()
    bench.signals.fault(Reason.GUARD_LOST)
    assert bench.run(0.1).reason is Reason.GUARD_LOST
    bench.hand.trigger = 0.0
    bench.signals.confirm(bench.clock.now_ns())
    assert bench.run(1.0).arming is ArmingState.FAULT


def test_what_the_guard_says_is_the_reason_in_the_very_tick_that_hears_it(bench):
    bench.engage()
    hear = bench.beats.append

    def guard_stopped(now_ns):
        hear(now_ns)
        bench.arm.model.set_state(4)
        bench.signals.trip(Reason.GUARD_STOPPED)

    bench.beat = guard_stopped
    assert bench.run(1 / 120).reason is Reason.GUARD_STOPPED
    bench.beat = hear
    assert bench.run(0.1).reason is Reason.GUARD_STOPPED, "not that the arm was stopped"


def test_every_tick_beats_and_is_recorded(bench):
    bench.run(1.0)
    assert len(bench.beats) == len(bench.ticks) == 120


def test_the_kinematics_given_to_teleoperation_are_those_of_the_arm(bench):
    model = Lite6Model(offset_from_mm_deg(CONFIG.arm.tcp_offset_mm_deg))
    state = bench.arm.state()
    assert np.allclose(model.tcp_pose(state.joints).position, state.tcp.position, atol=1e-6)


def test_an_emergency_stop_stops_the_arm_before_the_next_tick(bench):
    bench.engage()
    bench.signals.estop()
    bench.clock.advance_ns(20_000_000)  # until the next report
    assert bench.arm.state().activity is Activity.STOPPED
    assert bench.run(1 / 120).reason is Reason.EMERGENCY_STOP


def test_a_stop_in_the_middle_of_a_tick_is_no_other_reason(bench):
    """What the tick sees of the arm is from before: who stops it has signalled it by then."""
    bench.engage()
    bench.hand.velocity = np.array([0.0, 0.0, -0.1])
    take, reasons = bench.signals.take, []

    def estop_after(now_ns):
        pending = take(now_ns)
        if not reasons:
            bench.signals.estop()
            bench.ready = False
        return pending

    bench.signals.take = estop_after
    for _ in range(3):
        reasons.append(bench.run(1 / 120).reason)
    assert reasons == [None, Reason.EMERGENCY_STOP, Reason.EMERGENCY_STOP]
