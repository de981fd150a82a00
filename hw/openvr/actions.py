"""Buttons and pulses through SteamVR Input (IVRInput), which the operator can rebind.

Each pulse is a pattern of vibrations that is distinguished blind.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hw.openvr.bindings import ACTION_SET, HAPTIC_ACTION, input_action
from hw.openvr.components import ROLES, ButtonReading
from hw.openvr.runtime import OpenVrRuntime
from tams_app.records import Haptic
from tams_app.units import NS_PER_MS, NS_PER_S

MIN_GAP_NS = 5 * NS_PER_MS  # a runtime may ignore what comes sooner


@dataclass(frozen=True, slots=True)
class Vibration:
    """One stretch of vibration; amplitude 0..1."""

    duration_s: float
    frequency_hz: float
    amplitude: float


# (start after the beginning [s], vibration)
PATTERNS: dict[Haptic, tuple[tuple[float, Vibration], ...]] = {
    Haptic.ENGAGE: ((0.0, Vibration(0.06, 160.0, 0.8)),),
    Haptic.RELEASE: ((0.0, Vibration(0.03, 80.0, 0.4)),),
    Haptic.LIMIT: (
        (0.0, Vibration(0.02, 240.0, 0.6)),
        (0.06, Vibration(0.02, 240.0, 0.6)),
    ),
    Haptic.FAULT: tuple((start_s, Vibration(0.16, 120.0, 1.0)) for start_s in (0.0, 0.24, 0.48)),
}
# A hold or a fault by the link ends with a long one.
PATTERNS[Haptic.LINK_HOLD] = (*PATTERNS[Haptic.LIMIT], (0.14, Vibration(0.4, 160.0, 0.6)))
PATTERNS[Haptic.LINK_FAULT] = (*PATTERNS[Haptic.FAULT], (0.72, Vibration(0.4, 160.0, 0.6)))


class HapticPlayer:
    """Plays one pattern at a time: a new one cuts the old one off, but nothing cuts off a fault."""

    def __init__(self) -> None:
        self._pending: deque[tuple[int, Vibration]] = deque()
        self._playing: Haptic | None = None
        self._handed_ns = -MIN_GAP_NS

    def start(self, haptic: Haptic, now_ns: int) -> None:
        """Play from now on."""
        if self._pending and self._playing is not None and self._playing.is_fault:
            return
        self._playing = haptic
        self._pending = deque(
            (now_ns + round(start_s * NS_PER_S), vibration)
            for start_s, vibration in PATTERNS[haptic]
        )

    def due(self, now_ns: int) -> Vibration | None:
        """The vibration to hand to the device now; the newest if several have become due."""
        found = None
        if now_ns - self._handed_ns < MIN_GAP_NS:
            return found
        while self._pending and self._pending[0][0] <= now_ns:
            found = self._pending.popleft()[1]
            self._handed_ns = now_ns
        return found

    def silence(self) -> None:
        """Forget what is still to come."""
        self._pending.clear()


_DIGITAL = ("a", "b", "menu")


class ActionButtons:
    """Reads the actions of one hand.

    An action is active while something is bound to it, the controller is there and this process
    gets input: an open dashboard takes that away.
    """

    def __init__(self, runtime: OpenVrRuntime, manifest: Path, hand: str) -> None:
        """Before the first event is taken; the binding's InputError if SteamVR refuses."""
        vr = runtime.vr
        self._refusals = vr.error_code.InputError
        self._lost = vr.error_code.InputError_IPCError
        self._input = vr.VRInput()
        self._input.setActionManifestPath(str(manifest))
        # A single struct would be replaced by an empty one; it must be an array (FINDINGS 11).
        self._sets = (vr.VRActiveActionSet_t * 1)()
        self._sets[0].ulActionSet = self._input.getActionSetHandle(ACTION_SET)
        names = ("trigger", "grip", "grip_click", *_DIGITAL)
        self._actions = {name: self._input.getActionHandle(input_action(name)) for name in names}
        self._haptic = self._input.getActionHandle(HAPTIC_ACTION)
        self._device = self._input.getInputSourceHandle(f"/user/hand/{hand}")
        self.unread: tuple[str, ...] = ()  # what the last `read` could not read

    def read(self) -> ButtonReading | None:
        """The buttons now; None unless every one of them is there and this process may have it."""
        try:
            self._input.updateActionState(self._sets)
        except self._lost:
            raise
        except self._refusals:  # no input for this process at the moment
            self.unread = ROLES
            return None
        trigger, grip = self._analog("trigger"), self._grip()
        a, b, menu = (self._digital(name) for name in _DIGITAL)
        values = (trigger, grip, a, b, menu)
        self.unread = tuple(r for r, v in zip(ROLES, values, strict=True) if v is None)
        if trigger is None or grip is None or a is None or b is None or menu is None:
            return None
        return ButtonReading(trigger, grip, a, b, menu)

    def vibrate(self, vibration: Vibration) -> None:
        """Let the controller vibrate; does not wait until it has."""
        try:
            self._input.triggerHapticVibrationAction(
                self._haptic,
                0.0,
                vibration.duration_s,
                vibration.frequency_hz,
                vibration.amplitude,
                self._device,
            )
        except self._lost:
            raise
        except self._refusals:  # not bound, or the controller is gone
            return

    def _grip(self) -> float | None:
        analog = self._analog("grip")
        if analog is not None:
            return analog
        click = self._digital("grip_click")
        return None if click is None else float(click)

    def _analog(self, name: str) -> float | None:
        data = self._data(self._input.getAnalogActionData, name)
        return float(data.x) if data is not None else None

    def _digital(self, name: str) -> bool | None:
        data = self._data(self._input.getDigitalActionData, name)
        return bool(data.bState) if data is not None else None

    def _data(self, get: Any, name: str) -> Any:
        """The action's data, None unless it is active."""
        try:
            data = get(self._actions[name], self._device)
        except self._lost:
            raise
        except self._refusals:
            return None
        return data if data.bActive else None
