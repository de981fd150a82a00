"""The robot's side as the operator's session knows it: samples out, state in."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import add
from statistics import median

import numpy as np

from hw.controller import Controller
from tams_app.link.age import ClockOffset, PeerClock
from tams_app.link.gateway_client import LinkEvent, Received, Routes
from tams_app.link.messages import (
    HAND_RATE_HZ,
    HandMessage,
    MessageError,
    StateMessage,
    decode,
    encode,
)
from tams_app.prediction.forward_model import ArmHeard
from tams_app.prediction.present import Present
from tams_app.recording.journal import Journal
from tams_app.records import (
    ControllerSample,
    ControllerStatus,
    EpisodeRequest,
    Haptic,
    LinkHealth,
    StateHeard,
)
from tams_app.runtime.clock import Clock, FixedRate, SleepWatch
from tams_app.station.receivers import Identify, Receivers
from tams_app.station.robot_call import RobotCall
from tams_app.teleop.hands import SIMULATED
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrame, capture_of
from tams_app.video.core.packets import stream_ssrcs
from tams_app.video.live.udp import HOST, ViewPorts

_HEALTH_NS = NS_PER_S // 10
_TICK_NS = round(NS_PER_S / HAND_RATE_HZ)
_TAKEN_WITHIN_NS = 2 * _TICK_NS  # a sample that was received by the tick that a state tells of
_JOINTS = 6
_WAYS = 30  # half a second of states
_HAPTICS = {haptic.value: haptic for haptic in Haptic}
_AWAY = ControllerSample.released(ControllerStatus.OPERATOR_AWAY)
_FAILED = replace(_AWAY, status=ControllerStatus.DISCONNECTED)
_ASLEEP = replace(_AWAY, status=ControllerStatus.LINK_LOST)
_ASLEEP_NS = 200 * NS_PER_MS  # longer than any pose or button of before counts as fresh
_SLEPT = "this computer was suspended: what the controller told before is not sent, the arm stops"


class Requests:
    """The operator's requests by key or button; from any thread, also from a signal handler."""

    def __init__(self) -> None:
        self.confirms = self.stops = 0
        self.confirmed_ns = 0
        self.has_failed = False
        self.pinned = ""  # view that the operator has pinned; "": none
        self.episodes = (0, 0, 0, 0, 0)  # by `EpisodeRequest`

    def episode(self, request: EpisodeRequest) -> None:
        """Something is asked about episodes."""
        added = (one is request for one in EpisodeRequest)
        first, second, third, fourth, fifth = map(add, self.episodes, added)
        self.episodes = first, second, third, fourth, fifth

    def confirm(self, asked_ns: int) -> None:
        """The operator agrees: arm, or clear a fault. They did so at `asked_ns` at the earliest."""
        self.confirmed_ns = asked_ns
        self.confirms += 1

    def forget_confirmation(self) -> None:
        """One that was not sent yet is too old."""
        self.confirmed_ns = 0

    def estop(self) -> None:
        """Emergency stop."""
        self.stops += 1

    def fail(self) -> None:
        """This side has failed: from now on the hand is one that was put down."""
        self.has_failed = True


class RobotFrames:
    """The captures of the robot's side, by what its states say of the first of each view.

    `newest`: the state that was received last; None before it, and in another session of the link.
    """

    def __init__(self, views: Sequence[str]) -> None:
        self._views = views
        self.newest: StateMessage | None = None

    def identify(self) -> dict[str, Identify]:
        """By view, which capture an RTP timestamp stands for: its index is the timestamp itself.

        `capture_ns` is on the robot's clock, from what that side says of its first frame: None
        until it has.
        """
        return {view: partial(self._find, place) for place, view in enumerate(self._views)}

    def _find(self, place: int, timestamp: int) -> SentFrame | None:
        """In a receiver's thread."""
        state = self.newest
        if state is None or place >= len(state.first_capture_ns):
            return None
        first_ns = state.first_capture_ns[place]
        if first_ns is None:
            return None
        return SentFrame(timestamp, capture_of(timestamp, first_ns, state.sent_ns), 0)


class LinkedRobot:
    """A call that was answered; `step` and `run` are for the hand's thread.

    `run` is that thread's body; the others are from any. `sample`: what was sent last.
    """

    def __init__(
        self,
        clock: Clock,
        call: RobotCall,
        requests: Requests,
        log: Journal,
        receivers: Receivers,
        frames: RobotFrames,
        present: Present | None = None,
    ) -> None:
        """`receivers`: of the frames that the operator sees. `frames` gets the states, `present` is
        told of each sample and of the arm's states.
        """
        self._clock, self._requests, self._log = clock, requests, log
        self._receivers, self._frames = receivers, frames
        self.controller: Controller | None = None  # once it is started
        self.sample = _AWAY
        self.state_received_ns = 0
        self._session = 0
        self._identity, self._driven_with = call.identity, call.hand
        self._present = present
        self._ways_ns: deque[int] = deque(maxlen=_WAYS)
        self._haptics: int | None = None
        self._noted: int | None = None
        self._robots_clock = PeerClock()
        self._health_due_ns = 0
        self._sleep = SleepWatch(clock)
        self._asleep_until_ns = 0  # no sample is sent that may be from before we were suspended
        self._gateway = call.gateway
        self._video = call.config.video
        # of the views, in the order of messages
        self._places = {view: place for place, view in enumerate(self._video.views)}

    @property
    def state(self) -> StateMessage | None:
        """What the robot's side reported last; None before it has."""
        return self._frames.newest

    @property
    def event(self) -> LinkEvent:
        """The state of the link."""
        return self._gateway.event

    def connect(self, ports: Mapping[str, ViewPorts]) -> dict[str, ViewPorts]:
        """Hand the robot's streams over to `ports`, by view; where their feedback is to go."""
        rtp: dict[int, int] = {}
        rtcp: dict[int, int] = {}
        for view, one in ports.items():
            for ssrc in stream_ssrcs(self._video, view):
                rtp[ssrc], rtcp[ssrc] = one.rtp, one.reports
        self._gateway.follow(Routes(rtp, rtcp))
        entrance = ViewPorts(HOST, 0, 0, self._gateway.entrance_port)
        return dict.fromkeys(ports, entrance)

    @property
    def offset(self) -> ClockOffset | None:
        """The robot's clock minus ours; None before the first exchange."""
        return self._robots_clock.offset

    # --- in the hand's thread -------------------------------------------------------------------

    def run(self, stop: threading.Event) -> None:
        """Send a sample and take in what came, 120 times a second."""
        rate = FixedRate(self._clock, HAND_RATE_HZ)
        while not stop.is_set():
            rate.wait()
            self.step()

    def step(self) -> None:
        """Take in what was received, then send one sample."""
        for received in self._gateway.receive():
            self._take(received)
        now_ns = self._clock.now_ns()
        if self._sleep.slept():
            self._asleep_until_ns = now_ns + _ASLEEP_NS
            self._requests.forget_confirmation()
            self._robots_clock.wake(now_ns)
            self._log.note("warning", _SLEPT)
        self.sample = self._sample_now(now_ns)
        self._gateway.send(encode(self._hand(self.sample)))
        if self._present is not None:
            self._present.sent(self.sample, now_ns)
        if now_ns >= self._health_due_ns:
            self._health_due_ns = now_ns + _HEALTH_NS
            self._log.record(self._health(now_ns))

    def _sample_now(self, now_ns: int) -> ControllerSample:
        controller = self.controller
        if self._requests.has_failed:
            return _FAILED
        if controller is None:
            return _AWAY
        sample = controller.sample(now_ns)
        if now_ns < self._asleep_until_ns:
            return replace(_ASLEEP, presses=sample.presses)
        return sample

    def _take(self, received: Received) -> None:
        try:
            state = decode(received.content, StateMessage)
        except MessageError as error:
            self._log.note("warning", f"a message of the robot's side was left out: {error}")
            return
        if received.session != self._session:
            self._begin(received.session)
        before, self._frames.newest = self.state, state
        self.state_received_ns = received.heard_ns
        if before is not None:
            self._robots_clock.step(
                state.echo_ns, state.echo_heard_ns, state.sent_ns, received.heard_ns
            )
        self._log.record(StateHeard(received.heard_ns, state.sent_ns, state.echo_ns))
        self._tell_of_arm(state)
        self._feel(state)
        self._notify(state)

    def _tell_of_arm(self, message: StateMessage) -> None:
        """Hand the arm's state to what predicts it, once the clocks are known."""
        state, offset = message.state, self.offset
        knows = len(state.joints_urad) == _JOINTS and message.echo_ns > 0
        if self._present is None or offset is None or not knows:
            return
        try:
            arming = ArmingState(state.arming)
        except ValueError:  # it has not begun to tick
            return
        self._ways_ns.append(message.echo_heard_ns - offset.offset_ns - message.echo_ns)
        arm = ArmHeard(
            t_ns=state.joints_ns - offset.offset_ns,
            joints=np.array(state.joints_urad) * 1e-6,
            until_ns=message.echo_ns - _TAKEN_WITHIN_NS,
            arming=arming,
            orientation_mode=state.orientation_mode,
            speed_scale=state.speed_scale,
            lag_ns=_TICK_NS // 2,  # until the tick that takes a sample, in the mean
        )
        way_ns, closed = round(median(self._ways_ns)), bool(state.gripper_closed)
        self._present.heard(arm, way_ns, offset.offset_ns, closed)

    def _begin(self, session: int) -> None:
        self._session = session
        self._robots_clock.forget()
        self._ways_ns.clear()
        self._frames.newest = None
        self._log.note("info", f"connected to the robot at {self.event.address}")

    def _feel(self, state: StateMessage) -> None:
        """Play the last pulse, if there has been one since the last message."""
        felt, self._haptics = self._haptics, state.haptics
        controller = self.controller
        if felt is not None and state.haptics > felt and controller is not None:
            controller.pulse(_HAPTICS.get(state.haptic, Haptic.LIMIT))

    def _notify(self, state: StateMessage) -> None:
        """Pass on the sentences that are new; the last few are repeated, older ones are lost."""
        noted, self._noted = self._noted, state.noted
        new = len(state.notes) if noted is None else state.noted - noted
        for text in state.notes[-new:] if new > 0 else ():
            self._log.note("info", text)

    def _hand(self, sample: ControllerSample) -> HandMessage:
        state, requests, pose = self.state, self._requests, sample.pose
        presses = sample.presses
        views = [self._receivers.steered_by(view) for view in self._video.views]
        numbers = None
        if pose is not None:
            x, y, z = pose.position.tolist()
            numbers = (x, y, z, *pose.rotation)
        return HandMessage(
            operator=self._identity,
            simulated=self._driven_with == SIMULATED,
            sent_ns=self._clock.now_ns(),
            echo_ns=0 if state is None else state.sent_ns,
            echo_heard_ns=self.state_received_ns,
            status=sample.status.value,
            pose=numbers,
            pose_ns=sample.pose_ns,
            buttons_ns=sample.buttons_ns,
            trigger=sample.trigger,
            grip=sample.grip,
            a=sample.a,
            b=sample.b,
            menu=sample.menu,
            shown=tuple(view.index for view in views),
            confirms=requests.confirms,
            confirmed_ns=requests.confirmed_ns,
            stops=requests.stops,
            noted=self._noted or 0,
            presses=(presses.grip, presses.a, presses.b, presses.menu),
            hand=self._driven_with,
            damaged=tuple(view.is_damaged for view in views),
            episodes=requests.episodes,
            pinned=self._places.get(requests.pinned),
        )

    def _health(self, now_ns: int) -> LinkHealth:
        state, event, offset = self.state, self.event, self.offset
        age_ns = None
        if state is not None:
            age_ns = self._robots_clock.age_ns(state.sent_ns, state.echo_ns, now_ns)
        return LinkHealth(
            t_ns=now_ns,
            connected=event.connected and not event.left,
            age_bound_ns=age_ns,
            offset_ns=None if offset is None else offset.offset_ns,
            uncertainty_ns=None if offset is None else offset.uncertainty_ns,
            refused={},
            ignored=dict(event.counts),
        )
