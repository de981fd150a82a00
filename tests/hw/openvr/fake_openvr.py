"""An OpenVR runtime to be scripted: the real binding runs on the function tables built here.

Everything above the C interface is the real `openvr` package (init, tokens, structures, error
codes); what lies below is `FakeRuntime`, a plain object that a test sets as it likes.
"""

from __future__ import annotations

import ctypes
import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count, cycle
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any
from unittest.mock import patch

import numpy as np
import openvr
from scipy.spatial.transform import Rotation

from hw.controller import Controller
from tams_app.records import ControllerSample
from tams_app.units import NS_PER_S
from tests.hw.openvr.fake_overlays import FakeOverlays

HEADSET, RIGHT, LEFT, SPARE = 0, 3, 4, 7  # device indices
NO_DEVICE = openvr.k_unTrackedDeviceIndexInvalid
_TREMOR_M = cycle((1e-6, 1e-6, -2e-6))
_TOKENS = count(100)  # of all runtimes: the binding keeps what it found while the token stays
WAIT_S = 20.0  # then a thread that hangs in the runtime goes on


@dataclass
class FakeDevice:
    """One tracked device; `matrix` is the top of its pose, shape (3, 4)."""

    serial: str
    role: int = openvr.TrackedControllerRole_Invalid
    kind: int = openvr.TrackedDeviceClass_Controller
    controller_type: str = "vive_focus3_controller"
    model: str = "VIVE Focus 3 Controller"
    battery: float | None = 0.8
    connected: bool = True
    valid: bool = True
    result: int = openvr.TrackingResult_Running_OK
    activity: int = openvr.k_EDeviceActivityLevel_UserInteraction
    matrix: np.ndarray = field(default_factory=lambda: np.eye(3, 4))
    trembles: bool = False  # another pose each time it is asked for, a micrometre away
    pressed: int = 0  # bits of the controller state
    axes: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)] * 5)

    def put(self, position: tuple[float, float, float], rotation: Rotation | None = None) -> None:
        """Stand at `position` [m]."""
        turn = np.eye(3) if rotation is None else rotation.as_matrix()
        self.matrix = np.hstack([turn, np.array(position, dtype=float)[:, None]])


class FakeRuntime:
    """SteamVR with a headset and two controllers."""

    def __init__(self) -> None:
        self.installed = True
        self.running = True
        self.has_input_interface = True
        self.manifest_error = openvr.VRInputError_None
        self.update_error = openvr.VRInputError_None
        self.dashboard = False
        self.dashboard_takes_input = True
        self.input_available = True
        self.devices = {
            HEADSET: FakeDevice("HMD", kind=openvr.TrackedDeviceClass_HMD),
            RIGHT: FakeDevice("CTL_RIGHT", openvr.TrackedControllerRole_RightHand),
            LEFT: FakeDevice("CTL_LEFT", openvr.TrackedControllerRole_LeftHand),
        }
        self.devices[RIGHT].put((0.2, 1.1, -0.3))
        self.devices[LEFT].put((-0.2, 1.1, -0.3))
        self.standing = FakeDevice("standing")  # `matrix` leads from the raw frame to this one
        self.events: deque[int] = deque()
        self.bound = {"trigger", "grip", "a", "b", "menu"}  # actions with a component of ours
        self.actions: dict[tuple[str, str], float] = {}  # (hand, action) → value, else 0
        self.vibrations: list[tuple[str, float, float, float]] = []  # hand, s, Hz, amplitude
        self.joined_as: list[int] = []  # application types, in order
        self.launched = False  # an application started a runtime that was not running
        self.connections = 0
        self.quits_acknowledged = 0
        self.manifest: dict[str, Any] | None = None
        self.calls: list[str] = []
        self.readings = 0  # how often the actions were updated
        self.overlays = FakeOverlays()
        self._flowing = threading.Event()
        self._flowing.set()
        self._token = next(_TOKENS)
        self._names: dict[int, str] = {}
        self._types: dict[str, str] = {}
        self._active_sets: set[str] = set()
        self._keep: list[Any] = []
        self.tables = self._build_tables()

    # --- what a test does -----------------------------------------------------------------------

    def hang(self) -> None:
        """Answer nothing until `flow`."""
        self._flowing.clear()

    def flow(self) -> None:
        self._flowing.set()

    def press(self, action: str, value: float = 1.0, hand: str = "right") -> None:
        self.actions[hand, action] = value

    def await_reading(self) -> None:
        """Until the driver has read all that is so now: the reading under way may be older."""
        wanted, deadline_s = self.readings + 2, time.monotonic() + WAIT_S
        while self.readings < wanted:
            assert time.monotonic() < deadline_s, "the driver does not read"
            time.sleep(1e-3)

    def give_hand_to(self, index: int) -> None:
        """Let the device `index`, and no other, play the right hand."""
        role = openvr.TrackedControllerRole_RightHand
        for device in self.devices.values():
            if device.role == role:
                device.role = openvr.TrackedControllerRole_Invalid
        self.devices[index].role = role

    def recentre(self, degrees: float = 90.0) -> None:
        """Turn the standing frame, and all that is in it, about the vertical; without a word."""
        turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        for device in (self.standing, *self.devices.values()):
            device.matrix = turn @ device.matrix

    def quit(self) -> None:
        """Say goodbye to everybody and be gone."""
        self.events.append(openvr.VREvent_Quit)
        self.running = False

    def die(self) -> None:
        """Be gone without a word, as after SIGKILL."""
        self.running = False
        for device in self.devices.values():
            device.connected = device.valid = False

    def restart(self) -> None:
        self.running = True
        self.events.clear()
        for device in self.devices.values():
            device.connected = device.valid = True

    # --- the exports of libopenvr_api -----------------------------------------------------------

    @contextmanager
    def in_place_of_the_library(self) -> Iterator[FakeRuntime]:
        """Let the binding run on this runtime instead of libopenvr_api."""
        library = openvr._openvr
        with ExitStack() as stack:
            registry = stack.enter_context(NamedTemporaryFile(suffix=".vrpath"))
            stack.enter_context(patch.dict("os.environ", VR_PATHREG_OVERRIDE=registry.name))
            for name, export in self._exports().items():
                stack.enter_context(patch.object(library, name, export))
            stack.enter_context(self.in_place_of_structures())
            stack.callback(self.flow)
            yield self

    @contextmanager
    def in_place_of_structures(self) -> Iterator[None]:
        """Answer above the table what returns a structure: ctypes makes no callback that does."""
        name = "getRawZeroPoseToStandingAbsoluteTrackingPose"
        with patch.object(openvr.IVRSystem, name, lambda _: self._raw_to_standing()):
            yield

    def init_error(self, application: int) -> int:
        """What VR_Init says; an overlay application starts a runtime, a background one does not."""
        self.joined_as.append(application)
        if not self.installed:
            return openvr.VRInitError_Init_PathRegistryNotFound
        if not self.running and application == openvr.VRApplication_Background:
            return openvr.VRInitError_Init_NoServerForBackgroundApp
        self.launched = self.launched or not self.running
        return openvr.VRInitError_None

    def interface(self, name: str) -> int | None:
        """The address of a function table."""
        table = self.tables.get(name)
        if table is None or (name == openvr.IVRInput_Version and not self.has_input_interface):
            return None
        return ctypes.addressof(table)

    def _exports(self) -> dict[str, Any]:
        def init(error: int, application: int, _: bytes | None) -> int:
            self._wait("init")
            code = self.init_error(application)
            ctypes.c_int32.from_address(error).value = code
            self.connections += code == 0
            self._token = next(_TOKENS)
            return self._token

        def get(name: bytes, error: int) -> int | None:
            address = self.interface(name.decode().removeprefix("FnTable:"))
            code = 0 if address else openvr.VRInitError_Init_InterfaceNotFound
            ctypes.c_int32.from_address(error).value = code
            return address

        def shutdown() -> None:
            self.connections = max(0, self.connections - 1)

        pointer, text = ctypes.c_void_p, ctypes.c_char_p
        prototypes = {
            "VR_InitInternal2": (init, ctypes.c_uint32, pointer, ctypes.c_int32, text),
            "VR_GetGenericInterface": (get, pointer, text, pointer),
            "VR_IsInterfaceVersionValid": (
                lambda name: self.interface(name.decode()) is not None,
                ctypes.c_bool,
                text,
            ),
            "VR_GetInitToken": (lambda: self._token, ctypes.c_uint32),
            "VR_ShutdownInternal": (shutdown, None),
        }
        return {
            name: ctypes.CFUNCTYPE(result, *arguments)(function)
            for name, (function, result, *arguments) in prototypes.items()
        }

    # --- the function tables --------------------------------------------------------------------

    def _build_tables(self) -> dict[str, ctypes.Structure]:
        return {
            openvr.IVRSystem_Version: self._table(openvr.IVRSystem_FnTable, self._system()),
            openvr.IVROverlay_Version: self._table(
                openvr.IVROverlay_FnTable,
                {"isDashboardVisible": lambda: self.dashboard, **self.overlays.functions()},
            ),
            openvr.IVRInput_Version: self._table(openvr.IVRInput_FnTable, self._input()),
        }

    def _table(
        self, kind: type[ctypes.Structure], functions: dict[str, Callable[..., Any]]
    ) -> ctypes.Structure:
        """A table whose other entries are NULL, so that a call to one of them fails loudly."""
        table = kind()
        for name, prototype in kind._fields_:
            if name in functions:
                entry = self._entry(prototype, name, functions[name])
                self._keep.append(entry)
                setattr(table, name, entry)
        return table

    def _entry(self, prototype: Any, name: str, function: Callable[..., Any]) -> Any:
        def answer(*arguments: Any) -> Any:
            self._wait(name)
            return function(*arguments)

        if name == "getStringTrackedDeviceProperty":  # a c_char_p argument could not be written to
            arguments = [
                ctypes.c_void_p if a is ctypes.c_char_p else a for a in prototype._argtypes_
            ]
            entry = ctypes.CFUNCTYPE(prototype._restype_, *arguments)(answer)
            self._keep.append(entry)
            return ctypes.cast(entry, prototype)
        return prototype(answer)

    def _wait(self, name: str) -> None:
        self.calls.append(name)
        self._flowing.wait(WAIT_S)

    def _system(self) -> dict[str, Callable[..., Any]]:
        devices = self.devices

        def poses(origin: int, ahead_s: float, array: Any, count: int) -> None:
            for index in range(count):
                _fill_pose(array[index], devices.get(index))

        def poll(event: Any, size: int) -> bool:
            if not self.events:
                return False
            event.contents.eventType = self.events.popleft()
            return True

        def state(index: int, filled: Any, size: int) -> bool:
            device = devices.get(index)
            if device is None or not device.connected or not self._may_read():
                return False
            filled.contents.ulButtonPressed = device.pressed
            for number, (x, y) in enumerate(device.axes):
                filled.contents.rAxis[number].x, filled.contents.rAxis[number].y = x, y
            return True

        def by_role(role: int) -> int:
            found = (i for i, d in devices.items() if d.role == role and d.connected)
            return next(found, NO_DEVICE)

        return {
            "getDeviceToAbsoluteTrackingPose": poses,
            "pollNextEvent": poll,
            "getControllerState": state,
            "getTrackedDeviceIndexForControllerRole": by_role,
            "getControllerRoleForTrackedDeviceIndex": lambda i: devices[i].role,
            "getTrackedDeviceClass": lambda i: devices[i].kind if i in devices else 0,
            "isTrackedDeviceConnected": lambda i: devices[i].connected,
            "getTrackedDeviceActivityLevel": lambda i: devices[i].activity,
            "isInputAvailable": self._may_read,
            "acknowledgeQuit_Exiting": self._acknowledge_quit,
            "getStringTrackedDeviceProperty": self._string,
            "getBoolTrackedDeviceProperty": lambda i, p, e: devices[i].battery is not None,
            "getFloatTrackedDeviceProperty": lambda i, p, e: devices[i].battery or 0.0,
        }

    def _raw_to_standing(self) -> openvr.HmdMatrix34_t:
        self._wait("getRawZeroPoseToStandingAbsoluteTrackingPose")
        matrix = openvr.HmdMatrix34_t()
        for row, values in zip(matrix.m, self.standing.matrix, strict=True):
            row[:] = values.tolist()
        return matrix

    def _may_read(self) -> bool:
        return self.input_available and not (self.dashboard and self.dashboard_takes_input)

    def _acknowledge_quit(self) -> None:
        self.quits_acknowledged += 1

    def _string(self, index: int, prop: int, buffer: int | None, size: int, error: Any) -> int:
        device = self.devices[index]
        text = {
            openvr.Prop_SerialNumber_String: device.serial,
            openvr.Prop_ControllerType_String: device.controller_type,
            openvr.Prop_ModelNumber_String: device.model,
        }.get(prop, "")
        if not text:
            error[0] = openvr.TrackedProp_UnknownProperty
            return 0
        content = text.encode() + b"\0"
        error[0] = 0 if size >= len(content) else openvr.TrackedProp_BufferTooSmall
        if buffer and size >= len(content):
            ctypes.memmove(buffer, content, len(content))
        return len(content)

    def _input(self) -> dict[str, Callable[..., Any]]:
        def load(path: bytes) -> int:
            if self.manifest_error == 0:
                self.manifest = json.loads(Path(path.decode()).read_text(encoding="utf-8"))
                self._types = {a["name"]: a["type"] for a in self.manifest["actions"]}
            return self.manifest_error

        def handle(known: Callable[[str], bool]) -> Callable[..., int]:
            def get(name: bytes, out: Any) -> int:
                if not known(name.decode()):
                    return openvr.VRInputError_NameNotFound
                out[0] = len(self._names) + 1
                self._names[out[0]] = name.decode()
                return 0

            return get

        def update(sets: Any, size: int, count: int) -> int:
            self._active_sets = {self._names.get(sets[n].ulActionSet, "") for n in range(count)}
            self.readings += 1
            return self.update_error

        def read(kind: str, action: int, data: Any, device: int) -> int:
            name = self._names[action]
            if self._types[name] != kind:
                return openvr.VRInputError_WrongType
            hand, short = self._names[device].rpartition("/")[2], name.rpartition("/")[2]
            data.contents.bActive = self._is_active(hand, short)
            value = self.actions.get((hand, short), 0.0)
            if kind == "boolean":
                data.contents.bState = bool(value)
            else:
                data.contents.x = value
            return 0

        def vibrate(
            action: int, start_s: float, length_s: float, hz: float, strength: float, device: int
        ) -> int:
            hand = self._names[device].rpartition("/")[2]
            self.vibrations.append((hand, round(length_s, 3), round(hz, 1), round(strength, 2)))
            return 0

        return {
            "setActionManifestPath": load,
            "getActionSetHandle": handle(
                lambda name: name in (s["name"] for s in self.manifest["action_sets"])
            ),
            "getActionHandle": handle(lambda name: name in self._types),
            "getInputSourceHandle": handle(lambda name: name.startswith("/user/hand/")),
            "updateActionState": update,
            "getAnalogActionData": lambda a, d, size, device: read("vector1", a, d, device),
            "getDigitalActionData": lambda a, d, size, device: read("boolean", a, d, device),
            "triggerHapticVibrationAction": vibrate,
        }

    def _is_active(self, hand: str, action: str) -> bool:
        """As SteamVR: the set is active, something is bound, the hand is there, no dashboard."""
        role = getattr(openvr, f"TrackedControllerRole_{hand.title()}Hand")
        there = any(d.role == role and d.connected for d in self.devices.values())
        is_bound = action in self.bound and "/actions/tams" in self._active_sets
        return there and self._may_read() and is_bound


def _fill_pose(pose: Any, device: FakeDevice | None) -> None:
    pose.bPoseIsValid = device is not None and device.valid
    pose.bDeviceIsConnected = device is not None and device.connected
    if device is None:
        return
    pose.eTrackingResult = device.result
    if device.trembles:
        device.matrix[:, 3] += (next(_TREMOR_M), 0.0, 0.0)
    flat = np.ascontiguousarray(device.matrix, dtype=np.float32)
    ctypes.memmove(ctypes.addressof(pose), flat.ctypes.data, flat.nbytes)


def until(controller: Controller, holds: Callable[[ControllerSample], bool]) -> ControllerSample:
    """The first sample of which `holds` is true."""
    deadline_ns = time.monotonic_ns() + round(WAIT_S * NS_PER_S)
    while not holds(sample := controller.sample(time.monotonic_ns())):
        assert time.monotonic_ns() < deadline_ns, sample
        time.sleep(0.002)
    return sample
