"""The arm's reason not to move, and the operator's advice, as ROS 2's diagnostics."""

from __future__ import annotations

from tams_app.records import Tick
from tams_app.ros2.messages import DiagnosticStatus, KeyValue
from tams_app.telemetry.lines import Line
from tams_app.teleop.advice import advice
from tams_app.teleop.hands import HandWords
from tams_app.teleop.safety import ArmingState

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/msg/DiagnosticStatus
ARM_NAME, LINE_NAME = "TAMS: arm", "TAMS: message"

_ARMING_LEVELS = {ArmingState.HOLDING.value: WARN, ArmingState.FAULT.value: ERROR}
_LINE_LEVELS = {"info": OK, "warning": WARN}
_GRIPPER = {None: "unknown", False: "open", True: "closed"}


def arm_status(tick: Tick, hardware: str, hand: HandWords) -> DiagnosticStatus:
    """A hold is a warning, a fault an error; the message says what the operator does about it."""
    message = tick.arming
    if tick.reason:
        message += f", {advice(tick.reason, tick.lasting, hand)}"
    gripper = None if tick.arm is None else tick.arm.gripper_closed
    values = {
        "arming": tick.arming,
        "reason": tick.reason,
        "phase": tick.phase.value,
        "deadman": str(tick.deadman).lower(),
        "orientation_mode": str(tick.orientation_mode).lower(),
        "speed_scale": f"{tick.speed_scale:g}",
        "gripper": _GRIPPER[gripper],
    }
    level = _ARMING_LEVELS.get(tick.arming, OK)
    return DiagnosticStatus(level, ARM_NAME, message, hardware, _pairs(values))


def line_status(line: Line, hardware: str) -> DiagnosticStatus:
    """A sentence that the operator reads, or a stop that was measured."""
    level = _LINE_LEVELS.get(line.level, ERROR)
    return DiagnosticStatus(level, LINE_NAME, line.text, hardware, _pairs({"kind": line.kind}))


def _pairs(values: dict[str, str]) -> list[KeyValue]:
    return [KeyValue(key, value) for key, value in values.items()]
