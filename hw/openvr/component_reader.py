"""Every component of a controller through the state that knows no bindings, for calibration."""

from __future__ import annotations

from typing import Any

from hw.openvr.components import (
    COMPONENTS,
    Axis,
    Button,
    ComponentReading,
    PadSide,
    StatePlace,
)
from hw.openvr.devices import identify
from hw.openvr.runtime import OpenVrRuntime, binding_errors
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError

_PAD_BUTTON = 32  # k_EButton_SteamVR_Touchpad, axis 0
_PAD_EDGE = 0.3  # from the middle, of the pad's radius


class ComponentReader:
    """Reads every component of the operator's controller, whatever part it plays.

    For `calibrate frame`: the controller state knows nothing of actions and bindings, so a wrong
    mapping cannot hide a button. No thread: calls wait for the runtime. Not while an
    `OpenVrController` is open.
    """

    def __init__(self, config: ControllerConfig) -> None:
        """DeviceError or SetupError with one sentence if there is no runtime."""
        self._hand = config.hand
        self._runtime = OpenVrRuntime.join()

    def read(self) -> ComponentReading | None:
        """Now; None while the controller is away or SteamVR keeps its input.

        DeviceError for a controller that is not in the table, and if SteamVR is gone.
        """
        runtime = self._runtime
        try:
            for event in runtime.events():
                if event == runtime.vr.VREvent_Quit:
                    runtime.system.acknowledgeQuit_Exiting()
                    raise DeviceError("SteamVR has quit: start it, then try again.")
            return self._read(runtime)
        except binding_errors(runtime.vr) as error:
            raise DeviceError(
                f"The connection to SteamVR broke ({type(error).__name__}): try again."
            ) from error

    def close(self) -> None:
        """Disconnect from the runtime; may be called twice."""
        self._runtime.close()

    def _read(self, runtime: OpenVrRuntime) -> ComponentReading | None:
        index = runtime.hand_device(self._hand)
        if index is None:
            return None
        kind = identify(runtime, index).controller_type
        if kind not in COMPONENTS:
            raise DeviceError(
                f"Controllers of the type {kind or 'that SteamVR does not tell'} are not known: "
                f"use one of {', '.join(COMPONENTS)}, or leave the buttons with --no-buttons."
            )
        available, state = runtime.system.getControllerState(index)
        if not available:
            return None
        values = {
            component.path: component_value(state, component.place)
            for component in COMPONENTS[kind][self._hand]
            if component.place is not None
        }
        return ComponentReading(kind, values)


def component_value(state: Any, place: StatePlace) -> float:
    """The pull of a component in the controller state, 0..1."""
    match place:
        case Axis(number):
            return float(state.rAxis[number].x)
        case Button(number):
            return float(_is_pressed(state, number))
        case PadSide():
            east, north = place.value
            towards = state.rAxis[0].x * east + state.rAxis[0].y * north
            return float(_is_pressed(state, _PAD_BUTTON) and towards > _PAD_EDGE)


def _is_pressed(state: Any, number: int) -> bool:
    return bool(state.ulButtonPressed >> number & 1)
