"""What the one engine of both clocks promises: who hears what first, and how a phase travels."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hw.arms import session_boundary
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel, IdealPlant
from tams_app.config import load_config
from tams_app.records import (
    Allocation,
    Frame,
    Outcome,
    Phase,
    PhaseChange,
    Pose,
    SceneTruth,
    ShownFrame,
    Tick,
)
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.engine import Engine
from tams_app.robot.ground import Ground
from tams_app.robot.listener import Listener
from tams_app.robot.operator import Operator
from tams_app.robot.trial import task_geometry
from tams_app.robot.video import Video
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.session.local_operator import LocalOperator
from tams_app.station.fresh_video import Displays, FreshVideo
from tams_app.video.live.networks import resolve_network
from tests.robot.test_control import PERIOD_NS, HeldController
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.untimed
CONFIG = load_config(None, {"network": "s2"})


class Person(Operator):
    """Who sees each frame at once, and holds a controller."""

    def __init__(self, controller, is_simulated=True):
        self._controller, self._is_simulated = controller, is_simulated
        self._fresh = FreshVideo(CONFIG.video.views, Displays())

    def take_controller(self):
        return self._controller

    @property
    def hand(self):
        return "sim"

    @property
    def is_simulated(self):
        return self._is_simulated

    def steered_by(self, view):
        return self._fresh.of(view)

    def see(self, shown):
        self._fresh.shown(shown)


class Mirror(Video):
    """Every frame is on the screen as soon as it was captured."""

    def __init__(self, ground, captured, *shown):
        super().__init__(ground, resolve_network(CONFIG, "s2"), 0, captured)
        self.targets = []
        self._shown = shown

    def set_targets(self, target_kbps):
        self.targets.append(target_kbps)

    def pad(self, size_bytes):
        """Nothing is probed."""

    def _wire_bytes(self):
        return 0

    def _send(self, frame, left_out):
        shown_ns = frame.capture_ns
        shown = ShownFrame(frame.view, frame.index, shown_ns, frame.image, frame.capture_ns, True)
        for hear in self._shown:
            hear(shown)


class Guard(Listener):
    """Notes when it is heard."""

    def __init__(self, heard):
        self._heard = heard

    def before_tick(self, now_ns):
        self._heard.append("guard beats")

    def receive(self, record):
        if isinstance(record, Tick):
            self._heard.append("guard follows")


class Bench:
    def __init__(self, truth_is_known=True):
        self.clock, self.heard = VirtualClock(), []
        ready = np.radians(np.array(CONFIG.arm.ready_joints_deg))
        self.model = ControllerModel(IdealPlant(), start_joints=ready)
        self.arm = InProcessArm(CONFIG.arm, self.clock, self.model)
        self.arm.connect()
        self.hand, self.signals = HeldController(), Signals()
        self.log = records = MemoryJournal(self.clock, self.heard.append)
        self.captured, self.shown = [], []
        self.person = Person(self.hand)
        shown = (self.person.see, records.record, self.shown.append)
        ground = Ground(CONFIG, self.clock, records, self.signals)
        self.video = Mirror(ground, self.captured.append, *shown)
        boundary = session_boundary(CONFIG.arm, CONFIG.limits)
        self.gate = ArmGate(self.arm, boundary, records.note)
        devices = ConnectedDevices(
            self.arm, self.gate, self.truth if truth_is_known else None, Guard(self.heard)
        )
        self.engine = Engine(ground, devices, self.person, self.video)

    def truth(self):
        """The block has lain in its container since long ago, and the gripper is open."""
        here = Pose(np.zeros(3), Rotation.identity())
        block = Pose(np.array([0.0, 0.0, task_geometry().block_rest_height]), here.rotation)
        return SceneTruth(self.clock.now_ns(), block, here, here, 0.0, 0.016)

    def tick(self, count=1):
        for _ in range(count):
            self.clock.advance_ns(PERIOD_NS)
            for view in CONFIG.video.views:
                image = np.zeros((2, 2, 3), np.uint8)
                self.video.push(Frame(view, 0, self.clock.now_ns(), image))
            self.engine.control.tick(self.clock.now_ns())
            self.gate.serve()

    def engage(self):
        self.tick(24)
        self.signals.confirm(self.clock.now_ns())
        self.tick(60)
        self.hand.trigger = 1.0
        self.tick(12)


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.arm.close()


def test_the_guard_is_heard_before_the_controller_and_the_arm_are_looked_at(bench, monkeypatch):
    for device, name in ((bench.hand, "sample"), (bench.arm, "state")):
        look = getattr(device, name)

        def noted(*arguments, look=look, name=name):
            bench.heard.append(name)
            return look(*arguments)

        monkeypatch.setattr(device, name, noted)
    bench.engine.control.tick(bench.clock.now_ns())
    assert bench.heard[:3] == ["guard beats", "sample", "state"]


def test_the_guard_follows_the_arming_before_anyone_is_told_of_it(bench):
    bench.engage()
    bench.heard.clear()
    bench.signals.estop()
    bench.tick()
    (told,) = [place for place, what in enumerate(bench.heard) if what.startswith("fault")]
    assert bench.heard.index("guard follows") < told


def test_a_phase_change_reaches_the_encoders_through_the_listeners_alone(bench):
    bench.engage()
    bench.engine.policy.step_if_due()
    bench.log.records.clear()
    bench.hand.a = True  # closes the gripper
    while not bench.log.of(PhaseChange):
        bench.tick()
    assert bench.log.of(PhaseChange)[0].phase is Phase.GRASP
    bench.engine.policy.step_if_due()
    assert [one.phase for one in bench.log.of(Allocation)] == [Phase.GRASP]
    assert bench.video.targets[-1] == bench.log.of(Allocation)[0].target_kbps


def test_the_log_has_the_tick_of_a_new_phase_right_after_it(bench):
    bench.engage()
    bench.log.records.clear()
    bench.hand.a = True
    bench.tick(24)
    kinds = [type(item) for item in bench.log.records]
    change = kinds.index(PhaseChange)
    assert kinds[change + 1] is Tick
    assert bench.log.records[change + 1].phase is Phase.GRASP


def test_a_frame_is_logged_and_remembered_before_it_is_sent_so_that_its_age_is_known(bench):
    bench.video.push(Frame("gt", 7, 1000, np.zeros((2, 2, 3), np.uint8)))
    assert bench.person.age_ns("gt", 1500) == 500
    assert bench.person.age_ns("eih", 1500) is None
    assert [type(item) for item in bench.log.records] == [Frame, ShownFrame]
    assert [frame.index for frame in (*bench.captured, *bench.shown)] == [7, 7]


@pytest.mark.parametrize(("device", "limited"), [("sim", True), ("keyboard", False)])
def test_a_person_who_tries_the_rig_has_no_time_limit(bench, device, limited):
    config = load_config(None, {"controller.device": device})
    bench.person._is_simulated = LocalOperator(
        SimpleNamespace(), SimpleNamespace(), config
    ).is_simulated
    bench.engage()
    bench.clock.advance_ns(round(CONFIG.trial.limit_s * 1e9) + 1)
    assert bench.engine.look().over is limited
    assert len(bench.log.of(SceneTruth)) == 1


def test_where_the_truth_is_not_known_the_trial_is_not_judged():
    bench = Bench(truth_is_known=False)
    bench.engage()
    assert not bench.engine.look().over
    assert bench.engine.outcome("ended by q") == Outcome(None, None, None, None, "ended by q")
    bench.arm.close()
