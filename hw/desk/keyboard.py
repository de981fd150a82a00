"""The keyboard of the console's window as a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hw.controller import Controller
from tams_app.config import DeskConfig
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose, Presses
from tams_app.rotation import Rotation
from tams_app.runtime.mailbox import Mailbox
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import ZERO, Floats3, plus_times, shortened, times, towards

# By key, the axis and its direction: forward, left, up. The same keys turn about the axis that
# they would tilt the hand over; up and down turn it about the vertical.
_AXES: Mapping[str, tuple[int, float]] = {
    "w": (0, 1.0),
    "s": (0, -1.0),
    "a": (1, 1.0),
    "d": (1, -1.0),
    "r": (2, 1.0),
    "f": (2, -1.0),
}
DEADMAN, MODE, CLOSE, OPEN = "shift", "m", "c", "o"
KEYS = frozenset((*_AXES, DEADMAN, MODE, CLOSE, OPEN))  # that mean something here
TAP_M = 0.0015  # that one press of a key moves the hand, and no more until it counts as held
TAP_NS = 250 * NS_PER_MS  # a tap of 100 ms whose release is read 150 ms late is still one
LATE_NS = 100 * NS_PER_MS  # a report so late counts as new: a window may draw in between
SILENT_NS = 100 * NS_PER_MS  # a running window reports far more often
RAMP_S = 0.25  # from rest to full speed: soon enough for a tap, and no jump
_LONGEST_GAP_NS = 50 * NS_PER_MS  # what was asked for in a longer one is not made up for


@dataclass(frozen=True, slots=True)
class Deflection:
    """Deflection of each axis, -1 to 1, in the arm's base frame, and the buttons pressed.

    linear: forward, left, up. angular: turns about the same axes, right-handed. The buttons are
    those of `ControllerSample`.
    """

    linear: Floats3 = ZERO
    angular: Floats3 = ZERO
    trigger: float = 0.0
    grip: bool = False
    a: bool = False
    b: bool = False
    presses: Presses = field(default_factory=Presses)


@dataclass(slots=True)
class VirtualHand:
    """A hand that moves as fast as the axes are deflected; pure.

    It reaches the speed asked for within `RAMP_S` and stands still as soon as the
    deadman is let go. `rotation` takes the tracking frame to the arm's base frame
    (`HandConfig.rotation`): the hand's pose is in the tracking frame, as that of any controller.
    """

    config: DeskConfig
    rotation: tuple[Floats3, Floats3, Floats3]
    _position: Floats3 = ZERO
    _turn: Rotation = field(default_factory=Rotation.identity)
    _linear: Floats3 = ZERO
    _angular: Floats3 = ZERO
    _last_ns: int | None = None

    def step(self, now_ns: int, asked: Deflection) -> Pose:
        """The pose at `now_ns`."""
        gap_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        if asked.trigger <= 0.0 or not 0 < gap_ns <= _LONGEST_GAP_NS:
            self._linear = self._angular = ZERO
        else:
            self._go(gap_ns / NS_PER_S, asked)
        return Pose(np.array(self._position), self._turn)

    def _go(self, interval_s: float, asked: Deflection) -> None:
        config = self.config
        change = interval_s / RAMP_S
        # two axes at once are no faster than one
        for_linear = times(shortened(asked.linear, 1.0), config.speed_m_s)
        for_angular = times(shortened(asked.angular, 1.0), config.turn_rad_s)
        self._linear = towards(self._linear, for_linear, config.speed_m_s * change)
        self._angular = towards(self._angular, for_angular, config.turn_rad_s * change)
        way = self._in_tracking_frame(times(self._linear, interval_s))
        turn = self._in_tracking_frame(times(self._angular, interval_s))
        self._position = plus_times(self._position, way, 1.0)
        self._turn = self._turn.turned(turn)

    def _in_tracking_frame(self, vector: Floats3) -> Floats3:
        """The rotation's transpose, applied."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self.rotation
        x, y, z = vector
        return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


@dataclass(frozen=True, slots=True)
class HeldKeys:
    """The keys that are down in the window, reported again and again while it runs.

    keys: by the names in `KEYS`. focused: whether the window gets what is typed. t_ns: when the
    window's process reported it. presses: how often each key has gone down.
    """

    keys: frozenset[str]
    focused: bool
    t_ns: int
    presses: Mapping[str, int] = field(default_factory=dict)


class Taps:
    """Deflection by each key: a press makes a step, a key that stays down deflects in full; pure.

    When a key is read as up depends on what else the window draws, how often it went down does not.
    So for TAP_NS a press asks for the same whether the key is up again or not.
    """

    def __init__(self, speed_m_s: float) -> None:
        """`speed_m_s`: of the hand at full deflection."""
        self._share = min(TAP_M / (TAP_NS / NS_PER_S) / speed_m_s, 1.0)
        self._presses: Mapping[str, int] = {}
        self._down_ns: dict[str, int] = {}  # since when
        self._step_ns: dict[str, int] = {}  # until when its presses move the hand

    def step(self, now_ns: int, held: HeldKeys) -> dict[str, float]:
        """The deflection by key, 0 to 1; without the deadman nothing begins or goes on."""
        before, self._presses = self._presses, held.presses
        if DEADMAN not in held.keys:
            self._down_ns.clear()
            self._step_ns.clear()
            return {}
        return {
            key: self._of(key, held.presses.get(key, 0) - before.get(key, 0), now_ns, held)
            for key in _AXES
        }

    def _of(self, key: str, presses: int, now_ns: int, held: HeldKeys) -> float:
        if key not in held.keys:
            self._down_ns.pop(key, None)
        elif presses or key not in self._down_ns:
            self._down_ns[key], presses = now_ns, max(presses, 1)
        elif now_ns - self._down_ns[key] >= TAP_NS:
            return 1.0
        if presses:
            begin_ns = max(self._step_ns.get(key, 0), now_ns)
            self._step_ns[key] = min(begin_ns + presses * TAP_NS, now_ns + 2 * TAP_NS)
        return self._share if now_ns < self._step_ns.get(key, 0) else 0.0


class KeyboardController(Controller):
    """A hand that the held keys move; Shift is the deadman. It cannot be felt.

    `feed` is called with what the window reports, by any thread. A window without focus is a
    controller that is laid down, as is one that has not reported yet; pose and buttons of one that
    no longer reports freeze. A resting hand does not count as frozen: while the window reports, the
    pose is as new as the tick.
    """

    def __init__(self, config: DeskConfig, rotation: tuple[Floats3, Floats3, Floats3]) -> None:
        self._config, self._rotation = config, rotation
        self._held: Mailbox[HeldKeys] = Mailbox()
        self._started = False
        self._taps = Taps(config.speed_m_s)
        self._amounts: dict[str, float] = {}
        self._hand = VirtualHand(config, rotation)
        self._pose: Pose | None = None
        self._pose_ns = self._buttons_ns = 0

    def start(self) -> None:
        """Listen; the window need not be there yet."""
        self._started = True

    def feed(self, held: HeldKeys) -> None:
        """The keys that are down now."""
        self._held.put(held)

    def sample(self, now_ns: int) -> ControllerSample:
        if (held := self._held.latest()) is not None:
            self._amounts = self._taps.step(now_ns, held)
        if not self._started:
            self._pose_ns = self._buttons_ns = 0
            return ControllerSample.released(ControllerStatus.DISCONNECTED)
        if held is None or not held.focused:
            self._hand, self._pose = VirtualHand(self._config, self._rotation), None
            return ControllerSample.released(
                ControllerStatus.STANDBY, None, self._pose_ns, self._buttons_ns
            )
        asked = deflection_of(held.keys, held.presses, self._amounts)
        self._buttons_ns = max(self._buttons_ns, min(now_ns, held.t_ns + LATE_NS))
        if now_ns - held.t_ns <= SILENT_NS + LATE_NS or self._pose is None:
            self._pose, self._pose_ns = self._hand.step(now_ns, asked), now_ns
        return ControllerSample(
            ControllerStatus.OK,
            self._pose,
            self._pose_ns,
            self._buttons_ns,
            trigger=asked.trigger,
            grip=float(asked.grip),
            a=asked.a,
            b=asked.b,
            menu=False,
            presses=asked.presses,
        )

    def pulse(self, haptic: Haptic) -> None:
        """It cannot be felt."""

    def close(self) -> None:
        self._started = False
        self._held = Mailbox()


def deflection_of(
    keys: frozenset[str], presses: Mapping[str, int], amounts: Mapping[str, float]
) -> Deflection:
    """The deflection by held keys, of axes by the `amounts` of `Taps`; opposite ones cancel out."""
    axes = [0.0, 0.0, 0.0]
    for key, amount in amounts.items():
        axis, direction = _AXES[key]
        axes[axis] += direction * amount
    forward, left, up = axes
    return Deflection(
        linear=(forward, left, up),
        angular=(-left, forward, up),
        trigger=float(DEADMAN in keys),
        grip=MODE in keys,
        a=CLOSE in keys,
        b=OPEN in keys,
        presses=Presses(presses.get(MODE, 0), presses.get(CLOSE, 0), presses.get(OPEN, 0)),
    )
