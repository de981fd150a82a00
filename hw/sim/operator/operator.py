"""Mind of the simulated operator: from percepts and haptic pulses to what the hand does.

Operators do what they are taught: confirm, squeeze to move, let go when the image is gone or
nothing follows, and clear no fault by themselves but that of a link that was away: after any other
they wait until the experimenter has confirmed at the console.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from hw.sim.operator.efference import EfferenceCopy, FollowCheck
from hw.sim.operator.hand import Hand, HandCommand, ThumbButton, VelocityFollower
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import HandMap, Percept, Perception, ViewSight, norm
from hw.sim.operator.task import Intent, PickAndPlace, Stage
from tams_app.config import HandConfig, OperatorConfig
from tams_app.records import Haptic, Vector
from tams_app.units import NS_PER_MS, NS_PER_S

CONFIRM_HOLD_NS = 1_300 * NS_PER_MS  # the menu button must be held for 1 s
BLIND_AFTER_NS = 800 * NS_PER_MS  # a view older than this is no view: the operator lets go
_CAREFUL_AFTER_NS = 400 * NS_PER_MS
_LONGEST_STEP_NS = 100 * NS_PER_MS  # of a stalled caller; the hand rests for the remainder
_SQUEEZE_NS = 200 * NS_PER_MS  # at least; longer until the clutch's pulse is felt
_LONGEST_SQUEEZE_NS = 3_000 * NS_PER_MS  # where the pulse came after they had let go
_LET_GO_NS = 150 * NS_PER_MS
_PUZZLED_NS = 500 * NS_PER_MS
_SQUEEZES_BEFORE_CONFIRMING = 6
_MOVES_M = 0.002
_FAULT_REST_NS = 3_000 * NS_PER_MS
_GRIP_NS = 120 * NS_PER_MS  # pressed, and again until it is free
_STILL_M_S = 0.006
_STILL_RAD_S = 0.03
_STRETCHED = 0.85  # of the reach: time to re-clutch
_RETURN_BEYOND = 0.5  # of the reach: how far past the rest point the hand is taken
_RETURN_SPEED_M_S = 0.5
_RETURN_SPEED_RAD_S = 2.0
_RETURN_GAIN_PER_S = 3.5
_ENGAGED = 0.5  # of the trigger's travel: from here the arm is believed to follow
_NOTHING: Vector = np.zeros(3)


class HandActivity(StrEnum):
    """The operator's present activity with the hand."""

    WATCH = "watch"  # waits for an image
    CONFIRM = "confirm"
    SQUEEZE = "squeeze"
    MOVE = "move"
    TOGGLE = "toggle"
    LET_GO = "let go"
    RETURN = "return"  # takes the hand back to where it has room again
    PUZZLED = "puzzled"  # nothing followed
    WARY = "wary"  # felt a fault
    FINISHED = "finished"


class SimulatedOperator:
    """Decides what the hand does, step by step; deterministic from seed, times and percepts."""

    def __init__(
        self,
        hand: HandConfig,
        operator: OperatorConfig,
        perception: Perception,
        traits: ParticipantProfile,
        seed: int,
        confirms: bool = True,
        asked: EfferenceCopy | None = None,
    ) -> None:
        """`confirms`: the operator arms the arm; False when the session does (`--arm`).

        `asked`: what the hand asked of the tool, when the eyes use it too.
        """
        random = np.random.default_rng([seed, 0x09E7A])
        self.hand = Hand(random, operator.arm_reach_m, traits.tremor, traits.motor_noise)
        self.activity = HandActivity.WATCH
        self._map = HandMap(hand, traits, random)
        self._task = PickAndPlace(traits, hand.translation_scale, random)
        self._reaction_ns = round(traits.reaction_s * NS_PER_S)
        self._perception = perception
        self._asked = asked or EfferenceCopy()
        self._follows = FollowCheck()
        self._stuck = False
        self._tool_seen: Vector | None = None
        self._last_ns: int | None = None
        self._since_ns = 0
        self._after_letting_go = HandActivity.WATCH
        self._return_to: tuple[Vector, Vector] = (np.zeros(3), np.zeros(3))
        self._turning = False  # the mode the operator believes to be in
        self._confirms = confirms
        self._confirmed = not confirms
        self._felt_engage = False  # since the trigger was squeezed
        self._felt_late = False  # after it was released again
        self._squeezed_ns = 0  # the last time
        self._patience_ns = _SQUEEZE_NS + self._reaction_ns
        self._ever_engaged = False
        self._felt_hold = False
        self._felt_fault = False
        self._link_was_away = False  # and the arm is locked since
        self._failures = 0
        self._steps = {
            HandActivity.WATCH: self._watch,
            HandActivity.CONFIRM: self._confirm,
            HandActivity.SQUEEZE: self._squeeze,
            HandActivity.MOVE: self._move,
            HandActivity.TOGGLE: self._toggle,
            HandActivity.LET_GO: self._let_go,
            HandActivity.RETURN: self._return,
            HandActivity.PUZZLED: self._puzzled,
            HandActivity.WARY: self._wary,
            HandActivity.FINISHED: self._finished,
        }

    @property
    def stage(self) -> Stage:
        """The stage of the task that the operator believes to be in."""
        return self._task.stage

    def feel(self, haptic: Haptic) -> None:
        """A pulse in the hand."""
        if haptic is Haptic.ENGAGE:
            squeezed = self.activity in (
                HandActivity.SQUEEZE,
                HandActivity.MOVE,
                HandActivity.TOGGLE,
            )
            self._felt_late = not squeezed
            self._felt_engage = squeezed
            self._ever_engaged = True
            self._felt_fault = self._link_was_away = False
            self._felt_hold = False
        elif haptic in (Haptic.LIMIT, Haptic.LINK_HOLD):
            self._felt_hold = True
        elif haptic.is_fault:
            self._felt_fault = True
            self._link_was_away = haptic is Haptic.LINK_FAULT

    def step(self, now_ns: int) -> None:
        """Move the hand on to `now_ns`, which never goes back."""
        if self._last_ns is None:
            self._last_ns = self._since_ns = now_ns
        elapsed_ns = min(now_ns - self._last_ns, _LONGEST_STEP_NS)
        self._last_ns = now_ns
        if self._felt_late:  # on a far link: the next time they wait for it
            self._felt_late = False
            waited_ns = now_ns - self._squeezed_ns + self._reaction_ns
            self._patience_ns = min(max(self._patience_ns, waited_ns), _LONGEST_SQUEEZE_NS)
        sight = self._see(now_ns)
        command = self._steps[self.activity](now_ns, sight)
        self._act(now_ns, command, elapsed_ns / NS_PER_S)

    # --- eyes and hand --------------------------------------------------------------------------

    def _see(self, now_ns: int) -> ViewSight | None:
        """The sight to act on: None when there is no image, or only an old one."""
        percept = self._perception.look(now_ns)
        if percept is None or now_ns - percept.t_ns > BLIND_AFTER_NS:
            return None
        shown = self._asked.shown_at(percept.t_ns)
        under_way = self._asked.total - shown
        self._watch_whether_it_follows(percept, shown)
        return ViewSight(percept, under_way[:3], under_way[3:])

    def _act(self, now_ns: int, command: HandCommand, dt_s: float) -> None:
        """Move the hand, and note what that asks of the tool."""
        hand = self.hand
        arm, wrist = hand.arm.offset, hand.wrist.offset
        hand.step(command, dt_s)
        if hand.trigger < _ENGAGED or self.activity is HandActivity.LET_GO:
            self._asked.idle(now_ns)
        elif self._turning:
            turn = self._map.tool_angular @ (hand.wrist.offset - wrist)
            self._asked.add(now_ns, _NOTHING, turn)
        else:
            self._asked.add(now_ns, self._map.tool_linear @ (hand.arm.offset - arm), _NOTHING)

    def _watch_whether_it_follows(self, percept: Percept, shown: Vector) -> None:
        if self.activity is not HandActivity.MOVE:
            self._follows.reset()
        followed = self._follows.step(percept.t_ns, shown, percept.tcp)
        self._stuck = followed is False
        if followed:
            self._failures = 0

    # --- activities -----------------------------------------------------------------------------

    def _watch(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        if self._felt_fault and not self._link_was_away:
            self._begin(HandActivity.WARY, now_ns)
        elif sight is None or self._moves_by_itself(sight.percept):
            self._since_ns = now_ns
        elif now_ns - self._since_ns > self._reaction_ns:
            self._begin(HandActivity.SQUEEZE if self._confirmed else HandActivity.CONFIRM, now_ns)
        return HandCommand.still()

    def _moves_by_itself(self, percept: Percept) -> bool:
        """True if the tool is seen elsewhere than at the last call: it is then left alone."""
        position = percept.tcp.position
        enough = _MOVES_M + 3.0 * percept.tcp_sigma
        moved = self._tool_seen is None or norm(position - self._tool_seen) > enough
        if moved:
            self._tool_seen = position
        return moved

    def _confirm(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        held_ns = now_ns - self._since_ns
        if held_ns < CONFIRM_HOLD_NS:
            return HandCommand.still(button=ThumbButton.MENU)
        if held_ns > CONFIRM_HOLD_NS + self._reaction_ns:
            self._confirmed = True
            self._begin(HandActivity.WATCH, now_ns)
        return HandCommand.still()

    def _squeeze(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        elapsed_ns = now_ns - self._since_ns
        if self._felt_engage and elapsed_ns >= _SQUEEZE_NS:
            self._begin(HandActivity.MOVE, now_ns)
        elif elapsed_ns >= self._patience_ns:
            return self._release_then(self._after_no_response(), now_ns)
        return HandCommand.still(trigger=True)

    def _after_no_response(self) -> HandActivity:
        """Confirm, once for each squeeze that the arm did not answer, where the link was away."""
        if self._link_was_away and self._confirms:
            return HandActivity.CONFIRM
        return HandActivity.WARY if self._felt_fault else HandActivity.PUZZLED

    def _move(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        if self._felt_fault:
            return self._release_then(HandActivity.WARY, now_ns)
        if sight is None:
            return self._release_then(HandActivity.WATCH, now_ns)
        if self._stuck or self._felt_hold:
            return self._release_then(HandActivity.PUZZLED, now_ns)
        intent = self._task.step(now_ns, sight)
        if intent.done:
            return self._release_then(HandActivity.FINISHED, now_ns)
        if intent.turning is not None and intent.turning != self._turning:
            self._begin(HandActivity.TOGGLE, now_ns)
            return HandCommand.still(trigger=True)
        return self._follow(intent, now_ns, sight)

    def _toggle(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        """Still the hand, click the grip once, go on."""
        if not self._is_still() and self.hand.grip == 0.0:
            self._since_ns = now_ns
        elapsed_ns = now_ns - self._since_ns
        if elapsed_ns >= 2 * _GRIP_NS:
            self._turning = not self._turning
            self._begin(HandActivity.MOVE, now_ns)
        return HandCommand.still(trigger=True, grip=elapsed_ns < _GRIP_NS)

    def _let_go(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        if now_ns - self._since_ns >= _LET_GO_NS and self._is_still():
            self._begin(self._after_letting_go, now_ns)
        return HandCommand.still()

    def _return(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        arm = self._return_to[0] - self.hand.arm.offset
        wrist = self._return_to[1] - self.hand.wrist.offset
        if norm(arm) < 0.01 and norm(wrist) < 0.05 and self._is_still():
            self._begin(HandActivity.WATCH if sight is None else HandActivity.SQUEEZE, now_ns)
        return HandCommand(
            _towards(arm, _RETURN_SPEED_M_S),
            _towards(wrist, _RETURN_SPEED_RAD_S),
        )

    def _puzzled(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        """Nothing followed: not yet armed, held for a moment, or in the wrong mode?

        Confirms again only while the arm has never answered: once it is armed, the menu button is
        an emergency stop.
        """
        if now_ns - self._since_ns < _PUZZLED_NS:
            return HandCommand.still()
        if not self._felt_hold:
            self._reconsider()
        self._begin(HandActivity.WATCH, now_ns)
        return HandCommand.still()

    def _reconsider(self) -> None:
        self._failures += 1
        if self._felt_engage:
            self._turning ^= self._failures % 2 == 0
        elif not self._ever_engaged and self._failures % _SQUEEZES_BEFORE_CONFIRMING == 0:
            self._confirmed = not self._confirms

    def _wary(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        """After a fault: hands off, and now and then try whether it has been confirmed."""
        if now_ns - self._since_ns >= _FAULT_REST_NS and sight is not None:
            self._begin(HandActivity.SQUEEZE, now_ns)
        return HandCommand.still()

    def _finished(self, now_ns: int, sight: ViewSight | None) -> HandCommand:
        return HandCommand.still()

    # --- what the activities share --------------------------------------------------------------

    def _begin(self, activity: HandActivity, now_ns: int) -> None:
        self.activity = activity
        self._since_ns = now_ns
        self._stuck = False
        if activity is HandActivity.SQUEEZE:
            self._felt_engage = False
            self._squeezed_ns = now_ns

    def _release_then(self, activity: HandActivity, now_ns: int) -> HandCommand:
        self._after_letting_go = activity
        self._begin(HandActivity.LET_GO, now_ns)
        return HandCommand.still()

    def _follow(self, intent: Intent, now_ns: int, sight: ViewSight) -> HandCommand:
        age_ns = now_ns - sight.percept.t_ns
        fresh = (BLIND_AFTER_NS - age_ns) / (BLIND_AFTER_NS - _CAREFUL_AFTER_NS)
        fresh = min(1.0, max(0.0, fresh))
        linear = fresh * (self._map.hand_linear @ intent.linear)
        angular = fresh * (self._map.hand_angular @ intent.angular)
        if _stretched(self.hand.arm, linear) or _stretched(self.hand.wrist, angular):
            self._return_to = (
                _opposite(linear, self.hand.arm.reach),
                _opposite(angular, self.hand.wrist.reach),
            )
            return self._release_then(HandActivity.RETURN, now_ns)
        return HandCommand(linear, angular, trigger=True, button=intent.button)

    def _is_still(self) -> bool:
        hand = self.hand
        return norm(hand.arm.velocity) < _STILL_M_S and norm(hand.wrist.velocity) < _STILL_RAD_S


def _stretched(joint: VelocityFollower, command: Vector) -> bool:
    """True if the joint is near the end of its reach and asked to go on outwards."""
    return norm(joint.offset) > _STRETCHED * joint.reach and float(command @ joint.offset) > 0.0


def _opposite(command: Vector, reach: float) -> Vector:
    """A place on the other side of rest, from where the hand can travel far along `command`."""
    speed = norm(command)
    return -_RETURN_BEYOND * reach / speed * command if speed > 0.0 else np.zeros(3)


def _towards(error: Vector, speed: float) -> Vector:
    wanted = _RETURN_GAIN_PER_S * norm(error)
    return error * (_RETURN_GAIN_PER_S * (speed / wanted if wanted > speed else 1.0))
