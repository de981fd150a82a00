"""The controllers that the OpenVR runtime knows, and for calibration every component of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hw.openvr.components import (
    COMPONENTS,
    Axis,
    Button,
    ComponentReading,
    PadSide,
    StatePlace,
)
from hw.openvr.runtime import OpenVrRuntime, binding_errors, load_binding
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """The identity of a controller; the index counts only where there is no serial number."""

    serial: str
    controller_type: str


@dataclass(frozen=True, slots=True)
class ControllerInfo:
    """A controller as `doctor --devices` shows it."""

    role: str  # "left", "right", or "" for neither
    controller_type: str
    model: str
    serial: str
    battery: float | None  # 0..1; None: not reported
    connected: bool
    tracked: bool


def list_controllers() -> list[ControllerInfo]:
    """All controllers of the runtime, without starting one.

    DeviceError or SetupError with one sentence if there is none to ask. Not while a controller is
    open in this process: the binding has one connection.
    """
    vr = load_binding()
    runtime = OpenVrRuntime(vr.VRApplication_Background)
    try:
        return [
            _describe(runtime, index)
            for index in range(vr.k_unMaxTrackedDeviceCount)
            if runtime.system.getTrackedDeviceClass(index) == vr.TrackedDeviceClass_Controller
        ]
    except binding_errors(vr) as error:
        raise DeviceError(
            f"SteamVR did not tell its controllers ({error}): restart it, then try again."
        ) from error
    finally:
        runtime.close()


def identify(runtime: OpenVrRuntime, index: int) -> DeviceIdentity:
    """Serial and type of device `index`; two queries of the runtime: not for every sample."""
    vr = runtime.vr
    serial = _text(runtime, index, vr.Prop_SerialNumber_String)
    kind = _text(runtime, index, vr.Prop_ControllerType_String)
    return DeviceIdentity(serial or f"device {index}", kind)


def _describe(runtime: OpenVrRuntime, index: int) -> ControllerInfo:
    vr, system = runtime.vr, runtime.system
    roles = {vr.TrackedControllerRole_LeftHand: "left", vr.TrackedControllerRole_RightHand: "right"}
    pose = runtime.poses()[index]
    valid = bool(pose.bPoseIsValid) and pose.eTrackingResult == vr.TrackingResult_Running_OK
    connected = bool(system.isTrackedDeviceConnected(index))
    return ControllerInfo(
        roles.get(system.getControllerRoleForTrackedDeviceIndex(index), ""),
        _text(runtime, index, vr.Prop_ControllerType_String),
        _text(runtime, index, vr.Prop_ModelNumber_String),
        _text(runtime, index, vr.Prop_SerialNumber_String),
        _battery(runtime, index),
        connected,
        connected and valid,
    )


def _battery(runtime: OpenVrRuntime, index: int) -> float | None:
    vr, system = runtime.vr, runtime.system
    try:
        if not system.getBoolTrackedDeviceProperty(index, vr.Prop_DeviceProvidesBatteryStatus_Bool):
            return None
        return float(
            system.getFloatTrackedDeviceProperty(index, vr.Prop_DeviceBatteryPercentage_Float)
        )
    except vr.error_code.TrackedPropertyError:  # the driver does not know
        return None


def _text(runtime: OpenVrRuntime, index: int, name: int) -> str:
    """A string property, "" where the driver has none."""
    try:
        return str(runtime.system.getStringTrackedDeviceProperty(index, name))
    except runtime.vr.error_code.TrackedPropertyError:
        return ""


_PAD_BUTTON = 32  # k_EButton_SteamVR_Touchpad, axis 0
_PAD_EDGE = 0.3  # from the middle, of the pad's radius


class ComponentReader:
    """Reads every component of the operator's controller, whatever part it plays.

    For `calibrate frame`: the controller state is independent of actions and bindings, so a wrong
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
            if runtime.events().quits:
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
