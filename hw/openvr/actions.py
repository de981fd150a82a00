"""Buttons and pulses through SteamVR Input (IVRInput), which the operator can rebind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hw.openvr.bindings import ACTION_SET, HAPTIC_ACTION, input_action
from hw.openvr.components import ROLES, ButtonReading
from hw.openvr.haptics import Vibration
from hw.openvr.runtime import OpenVrRuntime

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
