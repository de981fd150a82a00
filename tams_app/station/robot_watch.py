"""The operator side's watch of the robot's: silence, a new session, the end, the state."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from tams_app.config import Config
from tams_app.link.messages import SessionDescription
from tams_app.records import LINK_LOST, Outcome, SessionState, TakeNote
from tams_app.runtime.clock import Clock
from tams_app.station.linked_robot import LinkedRobot
from tams_app.station.robot_call import BUSY
from tams_app.station.welcome import welcome_of
from tams_app.teleop.hands import hand_of, words_of_hand
from tams_app.units import NS_PER_MS


class RobotWatch:
    """Looks at the link from the main thread; `poll` it a few times a second."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        link: LinkedRobot,
        welcome: SessionDescription,
        note: TakeNote,
        end: Callable[[str], None],
    ) -> None:
        """`welcome`: of the session that we are in. `end` is notified why it is over."""
        self._config, self._clock, self._link = config, clock, link
        self._welcome, self._note, self._end = welcome, note, end
        self._silent = self._busy = False

    def poll(self) -> str:
        """Look after the robot's side; the first failure in one sentence, "" if none."""
        event, state = self._link.event, self._link.state
        if welcome_of(event) != self._welcome:
            return "the robot's side has begun another session: start this one again"
        if state is not None and state.ended:
            if state.failed:
                return f"the robot's side failed: {state.ended}"
            self._end(f"the robot's side: {state.ended}")
        elif event.left:
            self._end("the robot's side has ended the session")
        silent = self.receives_nothing()
        if silent and not self._silent:
            release = words_of_hand(hand_of(self._config)).release
            self._note(
                "warning",
                f"nothing is heard of the robot, whose arm stops by itself: {release}, "
                "and wait until the link is back",
            )
        if event.busy and not self._busy:
            self._note("warning", BUSY)
        self._silent, self._busy = silent, event.busy
        return ""

    def receives_nothing(self) -> bool:
        """Of the robot's side, for so long that its arm was stopped."""
        if self._link.state is None:
            return True
        silent_ms = (self._clock.now_ns() - self._link.state_received_ns) / NS_PER_MS
        return silent_ms > self._welcome.stopped_after_ms

    def outcome(self, reason: str) -> Outcome:
        """The task as far as it is known here: of a rig, whether the block was placed."""
        message = self._link.state
        placed = message is not None and message.state.placed
        return Outcome(placed if self._welcome.simulated else None, None, None, None, reason)

    def state(self, elapsed_s: float) -> SessionState:
        """The robot's, as it was reported last, and what is known here alone; views as reported."""
        message, robots = self._link.state, SessionState(t_s=0.0, arming=LINK_LOST)
        if message is not None:
            robots = message.state
        return replace(
            robots,
            t_s=elapsed_s,
            arming=LINK_LOST if self.receives_nothing() else robots.arming,
            hand=hand_of(self._config),
            pressed=self._link.sample.pressed,
            asked_fps=self._config.video.fps,
            now_ns=self._clock.now_ns(),
            heard_ns=None if message is None else self._link.state_received_ns,
        )
