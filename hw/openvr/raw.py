"""Every component of the operator's controller, whatever part it plays: for `calibrate frame`.

Read from the legacy state, which knows nothing of actions and bindings, so a wrong mapping cannot
hide a button. No thread: the caller's waits for the runtime.
"""

from __future__ import annotations

from hw.openvr.components import COMPONENTS, ComponentReading
from hw.openvr.devices import identify
from hw.openvr.legacy import component_value
from hw.openvr.runtime import OpenVrRuntime, binding_errors
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError


class RawComponents:
    """An open look at the controller of the configured hand; not while a controller is open."""

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
                    runtime.acknowledge_quit()
                    raise DeviceError("SteamVR has quit: start it, then try again.")
            return self._read(runtime)
        except binding_errors(runtime.vr) as error:
            raise DeviceError(
                f"The connection to SteamVR broke ({type(error).__name__}): try again."
            ) from error

    def close(self) -> None:
        """Let go of the runtime; may be called twice."""
        self._runtime.close()

    def _read(self, runtime: OpenVrRuntime) -> ComponentReading | None:
        vr = runtime.vr
        role = {
            "left": vr.TrackedControllerRole_LeftHand,
            "right": vr.TrackedControllerRole_RightHand,
        }[self._hand]
        index = int(runtime.system.getTrackedDeviceIndexForControllerRole(role))
        if index >= vr.k_unMaxTrackedDeviceCount:
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
            component.path: component_value(state, component.legacy)
            for component in COMPONENTS[kind][self._hand]
            if component.legacy is not None
        }
        return ComponentReading(kind, values)
