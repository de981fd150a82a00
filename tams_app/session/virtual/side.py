"""The robot's side in virtual time: rig, streams and engine, and what of them is due when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial

import numpy as np

from hw.arms import session_boundary, simulated_arm
from hw.sim.layout import VIEWS, draw_layout
from hw.sim.world.scene_renderer import CameraImages, stagger_ns
from hw.sim.world.world import World
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.recording.journal import Journal
from tams_app.records import (
    Frame,
    Outcome,
    PhaseChange,
    Record,
    SceneTruth,
    ShownFrame,
    TakeNote,
    Vector,
)
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.engine import Engine
from tams_app.robot.ground import Ground
from tams_app.robot.listener import Listener
from tams_app.robot.observers import TRIAL_RATE_HZ
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock
from tams_app.session.predicting import TrialMount
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.video import FrameScores, TrialVideo
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.virtual.stepped_clock import EventQueue

# From the instant a frame shows to the sender: what the live rig takes for drawing and handing
# over (docs/MEASUREMENTS.md, Live and virtual: medians of 18, 11 and 12 ms by view).
DELIVERY_NS = 12 * NS_PER_MS


class VirtualRobot:
    """The simulated rig's scene of `config.seed` with the arm at its ready pose. One thread."""

    def __init__(self, config: Config, clock: Clock, note: TakeNote) -> None:
        joints = np.radians(np.array(config.arm.ready_joints_deg))
        boundary = session_boundary(config.arm, config.limits)
        self.layout = draw_layout(config.seed)
        self._world = World(self.layout, joints)
        self.arm = simulated_arm(config.arm, clock, joints, boundary, self._world)
        self.gate = ArmGate(self.arm, boundary, note)

    def catch_up(self) -> int:
        """Bring arm and world up to the clock; the instant [ns] that they stand at then."""
        self.arm.state()
        return self.arm.simulated_ns

    @property
    def qpos(self) -> Vector:
        """All that a renderer needs to draw the world, shape (nq,)."""
        return self._world.qpos

    def truth(self) -> SceneTruth:
        """The true places of things now: for the trial's rules, never for the operator."""
        return self._world.truth(self.catch_up())

    def stop(self) -> None:
        """Stop the arm for good."""
        self.gate.stop()


class VirtualCameras:
    """Takes the frames of all views of `robot`, 30 a second each, as the renderer does live."""

    def __init__(
        self,
        config: Config,
        robot: VirtualRobot,
        events: EventQueue,
        video: Video,
    ) -> None:
        """`video` gets each frame `DELIVERY_NS` after its instant."""
        unknown = set(config.video.views) - set(VIEWS)
        if unknown:
            raise DeviceError(
                f"the simulated rig has no camera {min(unknown)!r}; use one of {', '.join(VIEWS)}"
            )
        self._views = config.video.views
        self._period_ns = NS_PER_S // config.video.fps
        self._robot = robot
        self._events = events
        self._video = video
        self._frames = CameraImages(robot.layout, config.seed)

    def start(self, now_ns: int) -> None:
        for view in self._views:
            first_ns = now_ns + stagger_ns(view, self._period_ns)
            self._events.post(first_ns, partial(self._take, view, 0, first_ns))

    def close(self) -> None:
        """Give the graphics back; may be called twice."""
        self._frames.close()

    def _take(self, view: str, index: int, due_ns: int) -> None:
        capture_ns = self._robot.catch_up()
        ready_ns = due_ns + DELIVERY_NS
        image = self._frames.take(view, index, self._robot.qpos)
        frame = Frame(view, index, capture_ns, image, ready_ns)
        self._events.post(ready_ns, partial(self._video.push, frame))
        next_ns = due_ns + self._period_ns
        self._events.post(next_ns, partial(self._take, view, index + 1, next_ns))


class VirtualRobotSide(Listener):
    """One engine and the events that move it. `begin` it, let time pass, `stop` it, `close` it."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        log: Journal,
        events: EventQueue,
        operator: VirtualOperator,
        scores: FrameScores,
        mount: TrialMount,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`scores` gets each frame before it is sent, and with `mount` when it was shown.

        `listeners`: besides those of a session.
        """
        ground = Ground(config, clock, log, Signals())
        listeners = (self, scores.regions, *listeners)
        self._events, self._operator = events, operator
        self._scores, self._mount = scores, mount
        self._rate_hz = config.control.rate_hz
        self.is_over = False  # the trial is
        with ExitStack() as stack:
            self._robot = robot = VirtualRobot(config, clock, log.note)
            self._video = TrialVideo(ground, self._show, scores.captured)
            stack.callback(self._video.close)
            self._cameras = VirtualCameras(config, robot, events, self._video)
            stack.callback(self._cameras.close)
            robot.arm.connect()
            devices = ConnectedDevices(robot.arm, robot.gate, robot.truth)
            self._engine = Engine(ground, devices, operator, self._video, listeners)
            self._stack = stack.pop_all()

    @property
    def started(self) -> bool:
        """The operator has engaged the arm."""
        assert self._engine.trial is not None, "virtual time knows the scene"
        return self._engine.trial.started

    def begin(self, now_ns: int) -> None:
        """From now on each part is due at its rate."""
        events = self._events
        self._engine.begin("virtual")
        self._cameras.start(now_ns)
        events.post(now_ns, self._step_policy)
        repeat(events, now_ns, self._rate_hz, self._tick)
        repeat(events, now_ns, TRIAL_RATE_HZ, self._look)

    def advance_to(self, now_ns: int) -> None:
        """Let everything happen to the video that is due up to `now_ns`."""
        self._video.advance_to(now_ns)

    def stop(self) -> None:
        """Stop the arm for good."""
        self._robot.stop()
        self._engine.finish()

    def outcome(self, reason: str) -> Outcome:
        """The verdict; `reason` says why the trial ended."""
        return self._engine.outcome(reason)

    def close(self) -> None:
        """Give everything back; may be called twice."""
        self._stack.close()

    def receive(self, record: Record) -> None:
        """Where the policy loop has been woken, let it step."""
        if isinstance(record, PhaseChange):
            self._events.post(record.t_ns, self._step_policy)

    def _tick(self, due_ns: int) -> None:
        self._operator.look(due_ns)
        self._engine.control.tick(due_ns)
        self._robot.gate.serve()

    def _show(self, frame: ShownFrame) -> None:
        """A frame is on the screen, after the captures that came before it."""
        self._operator.see(frame)
        self._scores.shown(frame)
        self._mount.shown(frame)

    def _look(self, _due_ns: int) -> None:
        self.is_over |= self._engine.look().over

    def _step_policy(self) -> None:
        """Step if it is due, and again in time; what a phase change has outdated ends here."""
        policy = self._engine.policy
        before_ns = policy.due_ns
        policy.step_if_due()
        if policy.due_ns != before_ns:
            self._events.post(policy.due_ns, self._step_policy)


def repeat(
    events: EventQueue, now_ns: int, rate_hz: float, action: Callable[[int], object]
) -> None:
    """Do `action` with its due time `rate_hz` times a second, first one period after `now_ns`."""
    period_ns = round(NS_PER_S / rate_hz)

    def again(due_ns: int) -> None:
        events.post(due_ns + period_ns, partial(again, due_ns + period_ns))
        action(due_ns)

    events.post(now_ns + period_ns, partial(again, now_ns + period_ns))
