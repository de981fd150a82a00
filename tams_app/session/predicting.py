"""The predictive display of a session, and what it is told of the arm."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from functools import partial

from hw.arms import arm_kind
from tams_app.config import Config, Network
from tams_app.prediction.camera_check import CameraCheck
from tams_app.prediction.forward_model import ArmHeard, ForwardModel
from tams_app.prediction.outline import links_of
from tams_app.prediction.present import (
    PREDICTED_FACT,
    CorrectedView,
    MountTrail,
    PredictedCamera,
    Present,
    WristView,
)
from tams_app.recording.journal import Journal
from tams_app.records import MountPrediction, Record, ShownFrame, Tick
from tams_app.robot.build import ready_pose
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.runtime.parts import Parts
from tams_app.session.lenses import WRIST_VIEW, known_cameras
from tams_app.session.viewing import scene_of, tool_tip
from tams_app.station.mount_memory import MEASURE, MountMemory, misfit
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS
from tams_app.video.live.networks import resolve_network

RATE_HZ = 120.0
_NOT_KNOWN = "view.predict: how the hand moves the arm is not known: all is shown as received"


class LateStates(Listener):
    """Tells `present` of each sample at once, and of the state as late as the network makes it.

    Where both sides are one process the hand moves the arm without delay. What is shown of it is
    corrected by what the operator's computer would know, with the whole of the jitter.
    """

    def __init__(self, present: Present, network: Network, at_once: bool = False) -> None:
        """`at_once`: with each tick; else `run`, or `step`, takes in what came since."""
        self._present, self._at_once = present, at_once
        self._delay_ns = round((network.latency_ms + network.jitter_ms) * NS_PER_MS)
        self._ticks: deque[Tick] = deque()
        self._coming: deque[tuple[int, ArmHeard, bool]] = deque()

    def receive(self, record: Record) -> None:
        """In the control thread, which `step` must not hold up."""
        if isinstance(record, Tick):
            self._ticks.append(record)
            if self._at_once:
                self.step()

    def run(self, stop: threading.Event, clock: Clock) -> None:
        """A thread's body: what came since, 120 times a second."""
        rate = FixedRate(clock, RATE_HZ)
        while not stop.is_set():
            rate.wait()
            self.step()

    def step(self) -> None:
        """Take in the ticks that are over; in one thread."""
        while self._ticks:
            self._take(self._ticks.popleft())

    def _take(self, tick: Tick) -> None:
        now_ns = tick.started_ns
        self._present.sent(tick.controller, now_ns)
        if tick.arm is not None:
            state = ArmHeard(
                t_ns=tick.arm.received_ns,
                joints=tick.arm.joints,
                until_ns=now_ns,
                arming=ArmingState(tick.arming),
                orientation_mode=tick.orientation_mode,
                speed_scale=tick.speed_scale,
            )
            closed = bool(tick.arm.gripper_closed)
            self._coming.append((now_ns + self._delay_ns, state, closed))
        while self._coming and self._coming[0][0] <= now_ns:
            _, state, closed = self._coming.popleft()
            self._present.heard(state, way_ns=0, closed=closed)


def predicted_cameras(config: Config) -> dict[str, PredictedCamera]:
    """By view, the cameras whose frames `view.predict` wants to be corrected."""
    scene = scene_of(config)
    if config.view.predict == "off" or scene.figure is None:
        return {}
    flange = scene.figure.flange
    tool, grip = scene.figure.solids[flange], scene.figure.grip
    tip, links = tool_tip(config, scene.figure), links_of(scene.figure)
    cameras = {}
    for view, lens in scene.lenses.items():
        if lens.parent == flange:
            cameras[view] = PredictedCamera(lens, tool, grip)
        elif config.view.predict == "all":
            cameras[view] = PredictedCamera(lens, tool, on_arm=False, tip=tip, links=links)
    return cameras


def as_received(config: Config) -> dict[str, str]:
    """By view, why its frames are not corrected although `view.predict` wants it: a clause."""
    if config.view.predict == "off":
        return {}
    known, predicted = known_cameras(config), predicted_cameras(config)
    only = config.view.predict == "eih" and WRIST_VIEW in known
    views = (WRIST_VIEW,) if only else tuple(known)
    return {
        view: "it is not on the arm" if known[view].lens else known[view].words
        for view in views
        if view not in predicted
    }


class TrialMount:
    """What `MountMemory` and `CameraWatch` are to a live session, in virtual time.

    `views`: what shows the frames of those that are corrected.
    """

    def __init__(self, cameras: Mapping[str, PredictedCamera], log: Journal) -> None:
        self._log, self._trail = log, MountTrail()
        self.views: dict[str, CorrectedView] = {
            view: camera.view(self._trail) for view, camera in cameras.items()
        }
        self._checks = {
            view: CameraCheck(one) for view, one in self.views.items() if isinstance(one, WristView)
        }

    @property
    def camera_fits(self) -> bool:
        return all(check.fits for check in self._checks.values())

    def put(self, prediction: MountPrediction) -> None:
        self._trail.add(prediction)

    def shown(self, frame: ShownFrame) -> None:
        """Each frame that reaches the screen."""
        if frame.view in self._checks and self._checks[frame.view].shown(frame):
            self._log.note("warning", misfit(frame.view))


class Beliefs:
    """Hands on to `mount` where it is believed to be, and the log keeps it."""

    def __init__(self, mount: MountMemory | TrialMount, log: Journal) -> None:
        self._mount, self._log = mount, log

    def tell(self, prediction: MountPrediction) -> None:
        self._mount.put(prediction)
        self._log.record(prediction)

    def camera_fits(self) -> bool:
        return self._mount.camera_fits

    def failed(self, error: Exception) -> None:
        """That is not the session's failure: frames are shown as received from then on."""
        text = f"the prediction failed ({error!r}): frames are shown as received"
        self._log.note("warning", text)


def follow_states(
    config: Config, clock: Clock, parts: Parts, log: Journal, mount: MountMemory | None
) -> tuple[LateStates, ...]:
    """What tells `mount` where the arm is, where both sides are one process; a thread works."""
    present = linked_present(config, config, log, mount)
    if present is None:
        return ()
    states = LateStates(present, resolve_network(config, config.network))
    parts.run("prediction", partial(states.run, clock=clock))
    return (states,)


def predicted_trial(config: Config, log: Journal) -> tuple[tuple[LateStates, ...], TrialMount]:
    """The same in virtual time, and what it tells."""
    cameras = predicted_cameras(config)
    mount = TrialMount(cameras, log)
    if not cameras:
        return (), mount
    log.fact(PREDICTED_FACT, ",".join(cameras))
    network = resolve_network(config, config.network)
    present = present_of(config, Beliefs(mount, log))
    return (LateStates(present, network, at_once=True),), mount


def linked_present(
    ours: Config, moves_by: Config | None, log: Journal, mount: MountMemory | None
) -> Present | None:
    """What tells `mount` where the arm is, also at the other end of a link.

    `moves_by`: the configuration by which it moves; None: that was not told.
    """
    for view, reason in as_received(ours).items():
        log.note("warning", f"{view.upper()} is shown as received: {reason}; measure it: {MEASURE}")
    if mount is None:
        return None
    log.fact(PREDICTED_FACT, ",".join(mount.cameras))
    if moves_by is None:
        log.note("warning", _NOT_KNOWN)
        return None
    beliefs = Beliefs(mount, log)
    present = present_of(moves_by, beliefs)
    present.on_failure = beliefs.failed
    return present


def present_of(config: Config, beliefs: Beliefs) -> Present:
    """What follows the arm's flange for those cameras; `beliefs` get where that is."""
    kind = arm_kind(config.arm.model)
    figure = kind.figure()
    assert figure is not None, "there are no such cameras without"
    model = ForwardModel(config, kind.kinematics(config.arm), ready_pose(config).rotation)
    return Present(model, figure, beliefs.tell, beliefs.camera_fits)
