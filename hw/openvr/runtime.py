"""The connection to the OpenVR runtime: loading the binding, opening, events, closing.

The runtime is one per process: its binding keeps a single connection, so only one of these may be
open at a time. All calls belong to one thread.
"""

from __future__ import annotations

import importlib
import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tams_app.errors import DeviceError, SetupError

MAX_EVENTS_PER_LOOK = 64
_NOT_INSTALLED = (
    "SteamVR is not installed for this user: install it, start it once, then try again."
)
_NOT_RUNNING = "SteamVR is not running: start it, switch the controller on, then try again."
_NO_HEADSET = "SteamVR finds no headset: connect it and check SteamVR's window, then try again."
_SENTENCES = {
    "Init_InstallationNotFound": _NOT_INSTALLED,
    "Init_InstallationCorrupt": _NOT_INSTALLED,
    "Init_VRClientDLLNotFound": _NOT_INSTALLED,
    "Init_PathRegistryNotFound": _NOT_INSTALLED,
    "Init_NoServerForBackgroundApp": _NOT_RUNNING,
    "Init_ShuttingDown": _NOT_RUNNING,
    "Init_HmdNotFound": _NO_HEADSET,
    "Init_HmdNotFoundPresenceFailed": _NO_HEADSET,
}


def load_binding() -> Any:
    """The `openvr` module; SetupError where it or its library cannot be loaded.

    Loaded only here, so that the simulated rig runs on machines OpenVR has no library for.
    """
    try:
        return importlib.import_module("openvr")
    except (ImportError, OSError, ValueError) as error:
        raise SetupError(
            f"The OpenVR library cannot be loaded ({error}): "
            "use an x86-64 machine and run `make setup`."
        ) from error


def is_registered() -> bool:
    """True if a runtime is registered for this user, or if that cannot be seen from here.

    Without the registry the OpenVR library prints on standard error. Its place on Linux:
    VR_PATHREG_OVERRIDE, else openvr/openvrpaths.vrpath in the user's configuration folder.
    """
    if platform.system() != "Linux":
        return True
    if override := os.environ.get("VR_PATHREG_OVERRIDE"):
        return Path(override).is_file()
    folder = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(folder, "openvr", "openvrpaths.vrpath").is_file()


def binding_errors(vr: Any) -> tuple[type[Exception], ...]:
    """The binding's exceptions: its own, and KeyError for a code that is newer than it."""
    return (vr.OpenVRError, KeyError)


@dataclass(frozen=True, slots=True)
class RuntimeEvents:
    """The events that matter: the runtime quits; the standing frame was moved."""

    quits: bool
    frame_moved: bool


class OpenVrRuntime:
    """An open connection; nothing but `close` may be called after `close`."""

    def __init__(self, application: int) -> None:
        """Connect as `application`, a VRApplication_*; DeviceError with one sentence if refused."""
        self.vr = load_binding()
        if not is_registered():
            raise DeviceError(_NOT_INSTALLED)
        try:
            self.system = self.vr.init(application)
        except binding_errors(self.vr) as error:
            raise DeviceError(_sentence(error)) from error
        self._poses = (self.vr.TrackedDevicePose_t * self.vr.k_unMaxTrackedDeviceCount)()
        self._event = self.vr.VREvent_t()
        self._frame_events = (  # recentred, or another room
            self.vr.VREvent_ChaperoneDataHasChanged,
            self.vr.VREvent_ChaperoneUniverseHasChanged,
            self.vr.VREvent_ChaperoneRoomSetupCommitted,
            self.vr.VREvent_SeatedZeroPoseReset,
            self.vr.VREvent_StandingZeroPoseReset,
        )
        self._open = True

    @classmethod
    def join(cls) -> OpenVrRuntime:
        """Connect as an overlay application, but never start a runtime that is not running.

        An overlay application would start it; a background application is refused instead, but
        gets no input.
        """
        vr = load_binding()
        cls(vr.VRApplication_Background).close()
        return cls(vr.VRApplication_Overlay)

    def events(self) -> RuntimeEvents:
        """The events since the last call; that it quits is acknowledged."""
        moved = False
        for _ in range(MAX_EVENTS_PER_LOOK):
            if not self.system.pollNextEvent(self._event):
                break
            kind = int(self._event.eventType)
            if kind == self.vr.VREvent_Quit:
                self.system.acknowledgeQuit_Exiting()
                return RuntimeEvents(True, moved)
            moved = moved or kind in self._frame_events
        return RuntimeEvents(False, moved)

    def poses(self) -> Any:
        """TrackedDevicePose_t of every device, now, in the standing universe.

        The array is used again by the next call.
        """
        return self.system.getDeviceToAbsoluteTrackingPose(
            self.vr.TrackingUniverseStanding, 0.0, self._poses
        )

    def hand_device(self, hand: str) -> int | None:
        """The index of the device that plays `hand` ("left" or "right"); None if none does."""
        vr = self.vr
        role = {
            "left": vr.TrackedControllerRole_LeftHand,
            "right": vr.TrackedControllerRole_RightHand,
        }[hand]
        index = int(self.system.getTrackedDeviceIndexForControllerRole(role))
        return index if index < vr.k_unMaxTrackedDeviceCount else None

    def rests(self, index: int) -> bool:
        """True if a device is not used at the moment: laid down, or taken off."""
        vr = self.vr
        return self.system.getTrackedDeviceActivityLevel(index) in (
            vr.k_EDeviceActivityLevel_Standby,
            vr.k_EDeviceActivityLevel_Idle_Timeout,
        )

    def close(self) -> None:
        """Disconnect; may be called twice. A runtime that quits ends processes that do not."""
        if self._open:
            self._open = False
            self.vr.shutdown()


def _sentence(error: Exception) -> str:
    name = type(error).__name__.removeprefix("InitError_")
    known = _SENTENCES.get(name)
    return known or f"SteamVR cannot be reached ({name}): restart it, then try again."
