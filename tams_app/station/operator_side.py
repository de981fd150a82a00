"""The operator's side of a link: its receivers, and the watch of the robot's side."""

from __future__ import annotations

from msgspec.structs import replace

from tams_app.config import Config
from tams_app.link.messages import SessionDescription
from tams_app.recording.journal import Journal
from tams_app.records import LINK_LOST, Outcome, SessionState
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Ending
from tams_app.station.linked_robot import LinkedRobot
from tams_app.station.receivers import Receivers
from tams_app.station.robot_call import BUSY, welcome_of
from tams_app.teleop.hands import hand_of, words_of_hand
from tams_app.units import NS_PER_MS

_STOP_SENT_NS = 100 * NS_PER_MS


class OperatorSide:
    """The operator's computer: main thread, but for `stop_arm`; it commands nothing."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        receivers: Receivers,
        link: LinkedRobot,
        welcome: SessionDescription,
        log: Journal,
        ending: Ending,
    ) -> None:
        """`welcome`, `ending`: of the session that we are in."""
        self._config, self._clock, self._receivers, self.link = config, clock, receivers, link
        self._welcome, self._log, self._ending = welcome, log, ending
        self._silent = self._busy = False

    def poll(self) -> str:
        """Look after streams and the robot's side: silence, a new session, the end."""
        return self._receivers.poll() or self._watch()

    def state(self) -> SessionState:
        """The robot's state, as it was reported last, with what is known here alone."""
        state, offset = self._robots_state(), self.link.offset
        offset_ns = None if offset is None else offset.offset_ns
        return replace(state, views=self._receivers.views(state.views, state.now_ns, offset_ns))

    def stop_arm(self, failed: bool) -> None:
        """Let go: the robot's side receives that the operator leaves, and stops."""
        if self.link.controller is not None:
            self.link.controller = None
            self._clock.sleep_until_ns(self._clock.now_ns() + _STOP_SENT_NS)

    def finish(self, reason: str, failed: bool) -> None:
        """Record the task as far as it is known here: of a rig, whether the block was placed.

        The gateway notifies the robot's side.
        """
        message = self.link.state
        placed = message is not None and message.state.placed
        completed = placed if self._welcome.simulated else None
        self._log.record(Outcome(completed, None, None, None, reason))

    def receives_nothing(self) -> bool:
        """Of the robot's side, for so long that its arm was stopped."""
        if self.link.state is None:
            return True
        silent_ms = (self._clock.now_ns() - self.link.state_received_ns) / NS_PER_MS
        return silent_ms > self._welcome.stopped_after_ms

    def _watch(self) -> str:
        event, state = self.link.event, self.link.state
        if welcome_of(event) != self._welcome:
            return "the robot's side has begun another session: start this one again"
        if state is not None and state.ended:
            if state.failed:
                return f"the robot's side failed: {state.ended}"
            self._ending.end(f"the robot's side: {state.ended}")
        elif event.left:
            self._ending.end("the robot's side has ended the session")
        silent = self.receives_nothing()
        if silent and not self._silent:
            release = words_of_hand(hand_of(self._config)).release
            self._log.note(
                "warning",
                f"nothing is heard of the robot, whose arm stops by itself: {release}, "
                "and wait until the link is back",
            )
        if event.busy and not self._busy:
            self._log.note("warning", BUSY)
        self._silent, self._busy = silent, event.busy
        return ""

    def _robots_state(self) -> SessionState:
        """With the views as reported."""
        message, robots = self.link.state, SessionState(t_s=0.0, arming=LINK_LOST)
        if message is not None:
            robots = message.state
        return replace(
            robots,
            t_s=self._ending.elapsed_s(),
            arming=LINK_LOST if self.receives_nothing() else robots.arming,
            hand=hand_of(self._config),
            pressed=self.link.sample.pressed,
            asked_fps=self._config.video.fps,
            now_ns=self._clock.now_ns(),
            heard_ns=None if message is None else self.link.state_received_ns,
        )
