"""The controllers that the OpenVR runtime knows."""

from __future__ import annotations

from dataclasses import dataclass

from hw.openvr.runtime import OpenVrRuntime, binding_errors, load_binding
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
    battery: float | None  # 0..1, None if it does not say
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
