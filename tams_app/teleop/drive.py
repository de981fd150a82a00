"""From the engaged hand to a command: clutch anchor, target, P-loop, limits, shaping."""

from __future__ import annotations

from tams_app.config import Config
from tams_app.records import ArmKinematics, ArmState, ControllerSample, Twist
from tams_app.rotation import Rotation
from tams_app.teleop.limits import Limits
from tams_app.teleop.motion import HandMotion, is_frozen
from tams_app.teleop.safety import Reason
from tams_app.teleop.servo import Target, Tcp, TcpPredictor
from tams_app.units import NS_PER_MS
from tams_app.vectors import ZERO, minus, plus, plus_times, times

_BRAKES_AFTER_MS = 70.0  # without a new pose: bridged times and jitter are shorter
_LIMITED_FOR_S = 0.3  # this long nothing is left of what the hand asks: the arm holds

# Of the position loop around the velocity servo: an error halves within .17 s, and no delay of the
# servo makes it swing.
POSE_GAIN_PER_S = 4.0


class Drive:
    """Makes the commanded velocity.

    After `engage` or `toggle_mode` the arm brakes first if it still moves; then hand and target are
    anchored to this controller pose and the *measured* arm pose, so that nothing ever jumps.
    """

    def __init__(self, config: Config, model: ArmKinematics, ready: Rotation) -> None:
        limits = config.limits
        fastest = (limits.max_speed_mm_s / 1000.0, limits.max_rotation_rad_s)
        self._hand = HandMotion(config.hand, config.freshness.hold_pose_ms * NS_PER_MS, fastest)
        self._limits = Limits(config, model, ready)
        self._target = Target(config.limits)
        self._predictor = TcpPredictor()
        self._anchored = False
        self._limited_s = 0.0
        self._limited_by: Reason | None = None
        self.orientation_mode = False
        self.joint_scale = 1.0
        self.twist = Twist.zero()

    @property
    def braking(self) -> bool:
        """Whether the stop profile was in force for the last twist."""
        return self._limits.used_stop_profile

    @property
    def fault(self) -> Reason | None:
        """The fault that the engaged hand or arm has made, if any."""
        if self._anchored and self._hand.impossible:
            return Reason.HAND_TOO_FAST
        if self._anchored and self._target.is_out_of_reach:
            return Reason.FOLLOWING_ERROR
        return None

    @property
    def hold(self) -> Reason | None:
        """The reason to hold: the arm drifts from the hand, or a limit blocks it for too long."""
        if self._anchored and self._hand.is_adrift(self.orientation_mode):
            return Reason.HAND_NOT_FOLLOWED
        return self._limited_by if self._limited_s >= _LIMITED_FOR_S else None

    def note_interval(self, now_ns: int, interval_s: float) -> None:
        """The last command was in force for `interval_s` until now."""
        self._predictor.sent(self.twist, now_ns, interval_s)

    def observe(self, arm: ArmState) -> None:
        """Look at a valid report: how far is the arm from where it should be?"""
        if self._anchored:
            self._target.watch(Tcp.of(arm.tcp))

    def engage(self) -> None:
        """Forget the past; `follow` brakes, and anchors as soon as the arm is at rest."""
        self._forget()

    def toggle_mode(self) -> None:
        """Switch between translation and orientation; an arm that moves brakes first."""
        self.orientation_mode = not self.orientation_mode
        self.engage()

    def reset(self) -> None:
        """At rest at once, in translation mode: the arm is stopped by other means."""
        self.halt()
        self.orientation_mode = False

    def halt(self) -> None:
        """At rest at once: the controller's deadman stopped the arm."""
        self._limits.reset()
        self._forget()
        self.twist = Twist.zero()

    def rest(self, interval_s: float) -> None:
        """Brake to exactly zero and stay there, for a hand that is not engaged."""
        self._forget()
        self.twist = self._limits.come_to_rest(interval_s)

    def follow(
        self,
        sample: ControllerSample,
        arm: ArmState,
        delay_ns: int,
        scale: float,
        now_ns: int,
        interval_s: float,
    ) -> None:
        """Engaged: one tick of hand to twist, `scale` for the frame's age.

        Without a new pose for 70 ms the arm brakes, before the hold that is due at 100 ms.
        """
        if not self._anchored:
            self._brake_then_anchor(sample, arm, interval_s)
            return
        measured = Tcp.of(arm.tcp)
        hand = self._hand.update(sample, now_ns, interval_s)
        if is_frozen(sample, now_ns, _BRAKES_AFTER_MS):
            self.twist = self._limits.come_to_rest(interval_s)
            self._advance_target(measured, Twist.zero(), 0.0, interval_s)
            return
        tcp = self._predictor.predict(measured, arm.received_ns, delay_ns)
        correction = self._correction(tcp)
        if self.orientation_mode:
            wanted = Twist(ZERO, plus(hand.angular, correction.angular))
        else:
            wanted = Twist(plus(hand.linear, correction.linear), ZERO)
        limited = self._limits.limit(wanted, tcp, arm.joints, scale)
        self.joint_scale = limited.joint_scale
        self._count_limited(limited.limited_by, interval_s)
        self.twist = self._limits.shape(limited.twist, tcp, arm.joints, interval_s)
        self._advance_target(measured, correction, scale * limited.joint_scale, interval_s)

    def _advance_target(
        self, measured: Tcp, correction: Twist, scale: float, interval_s: float
    ) -> None:
        """The target moves as commanded, without the commands that were to catch up with it."""
        self._target.advance(
            plus_times(self.twist.linear, correction.linear, -scale),
            plus_times(self.twist.angular, correction.angular, -scale),
            interval_s,
        )
        self._target.pull_back(measured)

    def _brake_then_anchor(
        self, sample: ControllerSample, arm: ArmState, interval_s: float
    ) -> None:
        self.twist = self._limits.come_to_rest(interval_s)
        if self._limits.at_rest:
            self._hand.anchor(sample)
            self._target.anchor(Tcp.of(arm.tcp))
            self._anchored = True

    def _correction(self, tcp: Tcp) -> Twist:
        """The P-loop that takes the arm back to the target."""
        target = self._target.tcp
        if self.orientation_mode:
            return Twist(ZERO, times(tcp.rotation.turn_to(target.rotation), POSE_GAIN_PER_S))
        return Twist(times(minus(target.position, tcp.position), POSE_GAIN_PER_S), ZERO)

    def _count_limited(self, limited_by: Reason | None, interval_s: float) -> None:
        self._limited_s = self._limited_s + interval_s if limited_by is not None else 0.0
        self._limited_by = limited_by

    def _forget(self) -> None:
        self._anchored = False
        self._limited_s = 0.0
        self._limited_by = None
        self.joint_scale = 1.0
