"""From our records to the messages of ROS 2: the same for the bridge and for bags.

Frames are those of REP 103 and 105: `base_link` is the arm's base (x forward, y left, z up), and
`<view>_optical` a camera's (z forward, x right, y down). Stamps are wall time, as in the log.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import nan
from typing import Any

from cyclonedds.idl import IdlStruct

from tams_app.recording import Facts, Header
from tams_app.recording.rates import Rates
from tams_app.recording.topics import OutcomeGiven
from tams_app.records import (
    Allocation,
    ArmState,
    EncodedFrame,
    Note,
    PhaseChange,
    Pose,
    SceneTruth,
    StopRecord,
    Tick,
)
from tams_app.ros2 import messages
from tams_app.telemetry.scene import (
    BASE,
    MOTION_HZ,
    Pace,
    PlacedFrame,
    Scene,
    Spoken,
    joint_angles,
    line_of,
    tcp_frame,
    thing_frames,
)
from tams_app.teleop.hands import HAND_FACT, HandWords, words_of
from tams_app.teleop.reasons import advice
from tams_app.teleop.safety import ArmingState

BASE_LINK = "base_link"
DIAGNOSTICS_HZ = 1.0
# the columns of /tams/rates; in its last row, of all views, those of one view are NaN
RATES = (
    *("target_kbps", "sent_kbps", "loss", "captured_fps", "shown_fps", "latency_ms"),
    *("live_ssim", "received_ssim", "task_live_ssim", "task_received_ssim"),
    *("budget_kbps", "capacity_kbps", "estimate_kbps", "queue_ms"),
)
ALL_VIEWS = "all"
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/msg/DiagnosticStatus
ARM_NAME, LINE_NAME = "TAMS: arm", "TAMS: message"

_ARMING_LEVELS = {ArmingState.HOLDING.value: WARN, ArmingState.FAULT.value: ERROR}
_LINE_LEVELS = {"info": OK, "warning": WARN}
_GRIPPER = {None: "unknown", False: "open", True: "closed"}


@dataclass(frozen=True, slots=True)
class Sent:
    """A message, its topic and its time in nanoseconds since 1970."""

    topic: messages.RosTopic
    message: IdlStruct
    wall_ns: int


class Conversion:
    """Takes the records of one session in their order."""

    def __init__(self, header: Header, scene: Scene | None) -> None:
        """Without a `scene`, the TCP is the only frame of the arm that is placed."""
        self._offset_ns = header.wall_offset_ns
        self._started_ns = header.started_ns
        self._hardware = str(header.config.get("arm", {}).get("model", ""))
        self._scene = scene
        self._views = set(() if scene is None else scene.lenses)
        self._reported_ns: int | None = None
        self._frames_pace = Pace(MOTION_HZ)
        self._diagnostics_pace = Pace(DIAGNOSTICS_HZ)
        self._published: tuple[str, str, str | None] = ("", "", "")
        self._hand = words_of({})
        self._as_the_authors = header.config.get("ros2", {}).get("dialect") == "reference"

    def opening(self) -> Iterator[Sent]:
        """The messages that hold for the whole session."""
        if self._scene is not None:
            wall_ns = self._started_ns + self._offset_ns
            yield self._transforms(messages.TF_STATIC, wall_ns, self._scene.still_frames())

    def of(self, record: Any) -> Iterator[Sent]:
        """The messages of a record, of which there may be none."""
        match record:
            case Tick():
                yield from self._on_tick(record)
            case SceneTruth():
                wall_ns = record.t_ns + self._offset_ns
                yield self._transforms(messages.TF, wall_ns, thing_frames(record))
            case PhaseChange():
                phase = messages.String(record.phase.value)
                yield Sent(messages.PHASE, phase, record.t_ns + self._offset_ns)
            case Allocation() if self._as_the_authors:
                yield from self._on_allocation(record)
            case Rates():
                yield self._on_rates(record)
            case EncodedFrame():
                yield self._on_frame(record)
            case Note() | StopRecord() | OutcomeGiven():
                yield self._on_line(record)
            case Facts() if HAND_FACT in record.values:
                self._hand = words_of(record.values)

    def _on_tick(self, tick: Tick) -> Iterator[Sent]:
        wall_ns = tick.started_ns + self._offset_ns
        linear, angular = (
            messages.Vector3(*map(float, part)) for part in (tick.twist.linear, tick.twist.angular)
        )
        twist = messages.TwistMsg(linear, angular)
        yield Sent(messages.TWIST, messages.TwistStamped(_header(wall_ns), twist), wall_ns)
        if tick.arm is not None and tick.arm.received_ns != self._reported_ns:
            self._reported_ns = tick.arm.received_ns
            yield from self._on_arm(tick.arm)
        current = (tick.arming, tick.reason, tick.lasting)
        due = self._diagnostics_pace.is_due(tick.started_ns)
        if due or current != self._published:
            self._published = current
            yield self._diagnostics(wall_ns, _arm_status(tick, self._hardware, self._hand))

    def _on_arm(self, arm: ArmState) -> Iterator[Sent]:
        wall_ns = arm.received_ns + self._offset_ns
        header = _header(wall_ns)
        place = messages.PoseMsg(messages.Point(*_xyz(arm.tcp)), _quaternion(arm.tcp))
        yield Sent(messages.TCP_POSE, messages.PoseStamped(header, place), wall_ns)
        angles = joint_angles(arm)
        joints = messages.JointState(header, list(angles), list(angles.values()), [], [])
        yield Sent(messages.JOINTS, joints, wall_ns)
        if self._frames_pace.is_due(arm.received_ns):
            scene = self._scene
            moved: Iterable[PlacedFrame] = (
                [tcp_frame(arm)] if scene is None else scene.arm_frames(arm)
            )
            yield self._transforms(messages.TF, wall_ns, moved)

    def _on_allocation(self, allocation: Allocation) -> Iterator[Sent]:
        """As the authors' nodes say it: again and again, for who comes late."""
        views = {view.upper(): kbps / 1000 for view, kbps in allocation.target_kbps.items()}
        targets = json.dumps({"phase": allocation.phase.word, "targets_mbps": views})
        for topic, text in zip(messages.AUTHORS, (allocation.phase.word, targets), strict=True):
            yield Sent(topic, messages.String(text), allocation.t_ns + self._offset_ns)

    def _on_rates(self, rates: Rates) -> Sent:
        rows = {one.view: [_number(one, name) for name in RATES] for one in rates.views}
        rows[ALL_VIEWS] = [_number(rates, name) for name in RATES]
        height, width = len(rows), len(RATES)
        dimensions = [
            messages.MultiArrayDimension(",".join(rows), height, height * width),
            messages.MultiArrayDimension(",".join(RATES), width, width),
        ]
        numbers = [number for row in rows.values() for number in row]
        array = messages.Float64MultiArray(messages.MultiArrayLayout(dimensions, 0), numbers)
        return Sent(messages.RATES, array, rates.t_ns + self._offset_ns)

    def _on_frame(self, frame: EncodedFrame) -> Sent:
        captured = messages.time_of(frame.capture_ns + self._offset_ns)
        video = messages.CompressedVideo(captured, optical(frame.view), frame.data, "h264")
        wall_ns = frame.encoded_ns + self._offset_ns
        return Sent(messages.video_topic(frame.view), video, wall_ns)

    def _on_line(self, record: Spoken) -> Sent:
        """A sentence that the operator reads, or a stop that was measured."""
        line = line_of(record)
        level, values = _LINE_LEVELS.get(line.level, ERROR), _pairs({"kind": line.kind})
        status = messages.DiagnosticStatus(level, LINE_NAME, line.text, self._hardware, values)
        return self._diagnostics(line.t_ns + self._offset_ns, status)

    def _diagnostics(self, wall_ns: int, status: IdlStruct) -> Sent:
        header = _header(wall_ns, "")
        return Sent(messages.DIAGNOSTICS, messages.DiagnosticArray(header, [status]), wall_ns)

    def _transforms(
        self, topic: messages.RosTopic, wall_ns: int, frames: Iterable[PlacedFrame]
    ) -> Sent:
        moved = [
            messages.TransformStamped(
                _header(wall_ns, self._frame(parent)),
                self._frame(child),
                messages.Transform(messages.Vector3(*_xyz(pose)), _quaternion(pose)),
            )
            for parent, child, pose in frames
        ]
        return Sent(topic, messages.TFMessage(moved), wall_ns)

    def _frame(self, name: str) -> str:
        """The name in ROS of one of our frames."""
        if name in self._views:
            return optical(name)
        return BASE_LINK if name == BASE else name


def optical(view: str) -> str:
    """The frame of a view's camera, whose axes are those of its picture."""
    return f"{view}_optical"


def _header(wall_ns: int, frame: str = BASE_LINK) -> Any:
    return messages.HeaderMsg(messages.time_of(wall_ns), frame)


def _xyz(pose: Pose) -> tuple[float, float, float]:
    x, y, z = pose.position.tolist()
    return x, y, z


def _quaternion(pose: Pose) -> Any:
    x, y, z, w = map(float, pose.rotation)
    return messages.Quaternion(x, y, z, w)


def _number(rates: object, name: str) -> float:
    """NaN for what was not measured, or is not of one view."""
    value = getattr(rates, name, None)
    return nan if value is None else float(value)


def _arm_status(tick: Tick, hardware: str, hand: HandWords) -> Any:
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
    return messages.DiagnosticStatus(level, ARM_NAME, message, hardware, _pairs(values))


def _pairs(values: dict[str, str]) -> list[IdlStruct]:
    return [messages.KeyValue(key, value) for key, value in values.items()]
