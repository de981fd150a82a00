"""The reading of the operator's controller from the OpenVR runtime, step by step.

No thread and no clock: `step` looks at the given time and never raises for what a runtime or a
controller may do; `hw.openvr.controller` calls it often enough. In order of precedence:

| seen                                                     | status         | pose | buttons |
|----------------------------------------------------------|----------------|------|---------|
| no runtime: it quit, or its connection broke             | RUNTIME_QUIT   |      |         |
| no device plays the hand, or it is not connected         | DISCONNECTED   |      |         |
| another device plays the hand (see HandKeeper)           | ROLE_SWAPPED   |      | menu    |
| the headset was recentred (see FrameKeeper)              | FRAME_CHANGED  |      | menu    |
| the controller rests, by its activity level              | STANDBY        |      |         |
| dashboard open, or buttons unread and input not for us   | DASHBOARD      | yes  |         |
| tracking result not OK, pose invalid, (0, 0, 0), no pose | TRACKING_LOST  |      | yes     |
| none of these                                            | OK             | yes  | yes     |

FRAME_CHANGED stands for TRACKING_FRAME_CHANGED. Buttons that are not in the table read as released.
With OK, buttons that cannot be read keep their value and their time, and become stale.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hw.openvr.actions import ActionButtons, HapticPlayer
from hw.openvr.components import COMPONENTS, ButtonReading
from hw.openvr.devices import DeviceIdentity, identify
from hw.openvr.runtime import OpenVrRuntime, binding_errors
from hw.openvr.tracking import (
    Announcer,
    FrameKeeper,
    HandKeeper,
    PoseKeeper,
    tracking_problem,
)
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError, TamsError
from tams_app.presses import PressCounter
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose, TakeNote
from tams_app.units import NS_PER_S

RETRY_NS = NS_PER_S
SILENT_NS = 2 * NS_PER_S  # a runtime without a single device has died without a word
RELEASED = ButtonReading()


@dataclass(frozen=True, slots=True)
class _View:
    """One look: the status, why, and what may be used of pose and buttons."""

    status: ControllerStatus
    why: str
    pose: Pose | None = None
    buttons: ButtonReading = RELEASED


class OpenVrPoller:
    """Owns the connection to the runtime; all calls belong to one thread."""

    def __init__(
        self,
        config: ControllerConfig,
        manifest: Path,
        note: TakeNote,
    ) -> None:
        self._counter = PressCounter()
        self._config, self._manifest, self._note = config, manifest, note
        self._announcer = Announcer(note)
        self._hand = HandKeeper()
        self._frame = FrameKeeper()
        self._pose = PoseKeeper()
        self._haptics = HapticPlayer()
        self._buttons, self._buttons_ns = RELEASED, 0
        self._runtime: OpenVrRuntime | None = None
        self._overlay: Any = None
        self._source: ActionButtons | None = None
        self._device: int | None = None
        self._identity: DeviceIdentity | None = None
        self._gone = _View(ControllerStatus.DISCONNECTED, "SteamVR was not asked yet")
        self._retry_ns = 0
        self._alone_since_ns: int | None = None

    def connect(self) -> None:
        """Join the running runtime; TamsError with one sentence if that fails."""
        runtime = OpenVrRuntime.join()
        try:
            self._overlay = runtime.vr.VROverlay()
            self._source = self._open_source(runtime)
        except binding_errors(runtime.vr) as error:
            runtime.close()
            raise DeviceError(
                f"SteamVR lacks something TAMS needs ({error}): update it, then try again."
            ) from error
        except TamsError:
            runtime.close()
            raise
        self._runtime = runtime
        self._alone_since_ns = None

    def step(self, now_ns: int) -> ControllerSample:
        """Look at everything once; a lost runtime is looked for again every RETRY_NS."""
        if self._runtime is None and now_ns >= self._retry_ns:
            self._retry(now_ns)
        view = self._look(now_ns)
        self._announcer.notify(view.status, view.why, now_ns)
        buttons = view.buttons
        return ControllerSample(
            view.status,
            view.pose,
            self._pose.changed_ns,
            self._buttons_ns,
            buttons.trigger,
            buttons.grip,
            buttons.a,
            buttons.b,
            buttons.menu,
            self._counter.presses,
        )

    def play(self, haptic: Haptic, now_ns: int) -> None:
        """Let the hand feel a pattern in this and the next steps; nothing without a runtime."""
        if self._source is not None:
            self._haptics.start(haptic, now_ns)

    def close(self) -> None:
        """Disconnect from the runtime; may be called twice."""
        self._haptics.silence()
        self._source = self._overlay = self._device = self._identity = None
        if self._runtime is not None:
            self._runtime.close()
            self._runtime = None

    # --- the runtime ----------------------------------------------------------------------------

    def _open_source(self, runtime: OpenVrRuntime) -> ActionButtons:
        vr, why = runtime.vr, "it has no SteamVR Input"
        # asking the binding for an interface that the runtime lacks would disconnect
        if vr.isInterfaceVersionValid(vr.IVRInput_Version):
            try:
                return ActionButtons(runtime, self._manifest, self._config.hand)
            except vr.error_code.InputError as error:
                why = type(error).__name__
        raise DeviceError(f"SteamVR does not take the actions of TAMS ({why}): update SteamVR.")

    def _retry(self, now_ns: int) -> None:
        self._retry_ns = now_ns + RETRY_NS
        try:
            self.connect()
        except TamsError as error:
            self._announcer.notify_failure(str(error))
            return
        self._announcer.forget_failure()
        self._note("info", "SteamVR is back")

    def _lose(self, why: str, now_ns: int) -> _View:
        self.close()
        self._gone = _View(ControllerStatus.RUNTIME_QUIT, why)
        self._retry_ns = now_ns + RETRY_NS
        return self._gone

    def _is_alone(self, poses: Any, now_ns: int) -> bool:
        """True if not one device, headset included, has been connected for SILENT_NS."""
        if any(pose.bDeviceIsConnected for pose in poses):
            self._alone_since_ns = None
            return False
        if self._alone_since_ns is None:
            self._alone_since_ns = now_ns
        return now_ns - self._alone_since_ns >= SILENT_NS

    # --- the controller -------------------------------------------------------------------------

    def _look(self, now_ns: int) -> _View:
        runtime, source = self._runtime, self._source
        if runtime is None or source is None:
            return self._gone
        try:
            events = runtime.events()
            if events.frame_moved:
                self._frame.note_event()
            if events.quits:
                return self._lose("SteamVR has quit", now_ns)
            self._frame.look(runtime.system.getRawZeroPoseToStandingAbsoluteTrackingPose())
            poses = runtime.poses()
            if self._is_alone(poses, now_ns):
                return self._lose("SteamVR no longer knows any device", now_ns)
            return self._look_at_hand(runtime, source, poses, now_ns)
        except binding_errors(runtime.vr) as error:
            return self._lose(f"the connection to SteamVR broke ({type(error).__name__})", now_ns)

    def _look_at_hand(
        self, runtime: OpenVrRuntime, source: ActionButtons, poses: Any, now_ns: int
    ) -> _View:
        index = self._find_hand(runtime, poses)
        if index is None:
            return _View(ControllerStatus.DISCONNECTED, "it is switched off or out of reach")
        identity = self._identify(runtime, index)
        vibration = self._haptics.due(now_ns)
        if vibration is not None:
            source.vibrate(vibration)
        read = source.read()
        trigger = read.trigger if read else None
        if self._hand.is_swapped(identity.serial, trigger, now_ns):
            why = f"now {identity.serial}"
            return self._mistrusted(ControllerStatus.ROLE_SWAPPED, why, read, now_ns)
        if self._frame.is_changed(trigger, now_ns):
            why = "let the trigger go for a second"
            return self._mistrusted(ControllerStatus.TRACKING_FRAME_CHANGED, why, read, now_ns)
        if runtime.rests(index):
            return _View(ControllerStatus.STANDBY, "pick it up to go on")
        problem = tracking_problem(runtime.vr, poses[index])
        pose = None if problem else self._pose.update(poses[index], now_ns)
        taken = self._input_taken_by(runtime, read)
        if taken:
            return _View(ControllerStatus.DASHBOARD, taken, pose)
        self._take(read, now_ns)
        if pose is None:
            return _View(ControllerStatus.TRACKING_LOST, problem, buttons=self._buttons)
        self._announcer.notify_unread(source.unread, now_ns)
        return _View(ControllerStatus.OK, "", pose, self._buttons)

    def _mistrusted(
        self, status: ControllerStatus, why: str, read: ButtonReading | None, now_ns: int
    ) -> _View:
        """Nothing counts but the menu button, which may still stop the arm."""
        self._take(ButtonReading(menu=read.menu) if read else None, now_ns)
        return _View(status, why, buttons=ButtonReading(menu=self._buttons.menu))

    def _take(self, read: ButtonReading | None, now_ns: int) -> None:
        """Keep a reading with its time; what could not be read leaves the last as it is."""
        if read is not None:
            self._buttons, self._buttons_ns = read, now_ns
            self._counter.update(read.grip, read.a, read.b, read.menu)

    def _input_taken_by(self, runtime: OpenVrRuntime, read: ButtonReading | None) -> str:
        """The cause that keeps the buttons from this process; "" if there is none."""
        if self._overlay.isDashboardVisible():
            return "close it to go on"
        if read is None and not runtime.system.isInputAvailable():
            return "another window takes the buttons"
        return ""

    def _find_hand(self, runtime: OpenVrRuntime, poses: Any) -> int | None:
        """The index of the connected device that plays the operator's hand."""
        index = runtime.hand_device(self._config.hand)
        if index is not None and poses[index].bDeviceIsConnected:
            return index
        self._device = None  # the next device is identified anew
        return None

    def _identify(self, runtime: OpenVrRuntime, index: int) -> DeviceIdentity:
        if self._identity is None or index != self._device:
            self._device, self._identity = index, identify(runtime, index)
            if self._identity.controller_type not in COMPONENTS:
                self._announcer.notify_unknown_type(self._identity.controller_type)
        return self._identity
