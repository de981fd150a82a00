"""The rig's controller with faults to be injected, as tracked controllers have them."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

from hw.sim.operator.virtual_controller import Holder, VirtualController, rig_wiring
from tams_app.config import OperatorConfig, load_config
from tams_app.records import ControllerSample, ControllerStatus, Haptic

NOTHING = ControllerSample.released(ControllerStatus.DISCONNECTED)


class SensorFault(Enum):
    """What really happens to a tracked controller, and the status the runtime gives it."""

    TRACKING_LOST = ControllerStatus.TRACKING_LOST  # no pose; the buttons go on
    STANDBY = ControllerStatus.STANDBY  # laid aside: neither pose nor buttons
    DASHBOARD = ControllerStatus.DASHBOARD  # poses go on; the runtime keeps the buttons
    DISCONNECTED = ControllerStatus.DISCONNECTED  # flat battery, out of radio reach
    RUNTIME_QUIT = ControllerStatus.RUNTIME_QUIT
    ROLE_SWAPPED = ControllerStatus.ROLE_SWAPPED  # another controller has the hand's role
    TRACKING_FRAME_CHANGED = ControllerStatus.TRACKING_FRAME_CHANGED  # the headset was recentred
    FROZEN_POSE = "frozen pose"  # status OK, the same pose for ever
    FROZEN_BUTTONS = "frozen buttons"  # status OK, the buttons as they last were


_WIRING = rig_wiring(load_config())
_WITHOUT_POSE = frozenset(
    {
        SensorFault.TRACKING_LOST,
        SensorFault.STANDBY,
        SensorFault.DISCONNECTED,
        SensorFault.RUNTIME_QUIT,
        SensorFault.ROLE_SWAPPED,
        SensorFault.TRACKING_FRAME_CHANGED,
    }
)
_WITH_FRESH_BUTTONS = frozenset({None, SensorFault.TRACKING_LOST, SensorFault.FROZEN_POSE})
_OUT_OF_HAND = frozenset(  # pulses do not reach the operator
    {SensorFault.DISCONNECTED, SensorFault.RUNTIME_QUIT, SensorFault.ROLE_SWAPPED}
)


class FaultyController(VirtualController):
    """A virtual controller that suffers the fault injected last."""

    _fault: SensorFault | None = None

    def __init__(self, operator: Holder, config: OperatorConfig, seed: int) -> None:
        super().__init__(operator, config, seed, _WIRING)

    def inject(self, fault: SensorFault | None) -> None:
        """From the next sample on suffer `fault`; None ends it."""
        self._fault = fault

    def pulse(self, haptic: Haptic) -> None:
        if self._fault not in _OUT_OF_HAND:
            super().pulse(haptic)

    def _read(self, now_ns: int) -> ControllerSample:
        whole, before, fault = super()._read(now_ns), self._last, self._fault
        if fault is None:
            return whole
        status = fault.value if isinstance(fault.value, ControllerStatus) else whole.status
        pose, pose_ns = whole.pose, whole.pose_ns
        if fault in _WITHOUT_POSE:
            pose, pose_ns = None, before.pose_ns
        elif fault is SensorFault.FROZEN_POSE and before.pose is not None:
            pose, pose_ns = before.pose, before.pose_ns
        if fault in _WITH_FRESH_BUTTONS:
            return replace(whole, status=status, pose=pose, pose_ns=pose_ns)
        held = before if status is ControllerStatus.OK else NOTHING
        return replace(
            held, status=status, pose=pose, pose_ns=pose_ns, buttons_ns=before.buttons_ns
        )
