"""Poses of arm, hand and things at a viewer's pace, from ticks and the rig's truth."""

from __future__ import annotations

import numpy as np
from foxglove import Context
from foxglove.channels import FrameTransformsChannel, JointStatesChannel, PoseInFrameChannel
from foxglove.messages import FrameTransforms, JointState, JointStates, PoseInFrame

from tams_app.recording.mcap_log import timestamp
from tams_app.records import ArmState, MountPrediction, Pose, SceneTruth, Tick
from tams_app.rotation import Rotation
from tams_app.telemetry.messages import BASE, pose_of, transform
from tams_app.telemetry.scene import TRACKING, Scene, thing_frames
from tams_app.units import NS_PER_S

MOTION_HZ = 30.0
PREDICTED = "flange predicted"  # the frame of where it is believed to be now
LED = "flange commanded"  # of where the hand's samples so far lead it


class Pace:
    """Of what comes, lets pass the first and then `rate_hz` a second."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None

    def is_due(self, t_ns: int) -> bool:
        """True if it is time, at `t_ns`; each True counts as sent."""
        due_ns = t_ns if self._due_ns is None else self._due_ns
        if t_ns < due_ns:
            return False
        self._due_ns = max(due_ns + self._period_ns, t_ns)  # what was missed is not made up for
        return True


class MotionChannels:
    """Sends what moves."""

    def __init__(self, context: Context, scene: Scene, offset_ns: int) -> None:
        """`offset_ns`: from the session's clock to that of the wall."""
        self._scene = scene
        self._offset_ns = offset_ns
        self._pace = Pace(MOTION_HZ)
        self._prediction_pace = Pace(MOTION_HZ)
        self._reported_ns = 0
        self._arm = FrameTransformsChannel("/tf", context=context)
        self._things = FrameTransformsChannel("/tf/things", context=context)
        self._predicted = FrameTransformsChannel("/tf/predicted", context=context)
        self._joints = JointStatesChannel("/joints", context=context)
        self._hand = PoseInFrameChannel("/pose/hand", context=context)
        self._commanded = PoseInFrameChannel("/pose/commanded", context=context)

    def on_tick(self, tick: Tick) -> None:
        """Report, command and hand of a tick, if it is time."""
        if not self._pace.is_due(tick.started_ns):
            return
        wall_ns = tick.started_ns + self._offset_ns
        if tick.controller.pose is not None:
            self._send(self._hand, wall_ns, TRACKING, tick.controller.pose)
        if tick.arm is None:
            return
        if tick.arm.received_ns != self._reported_ns:
            self._reported_ns = tick.arm.received_ns
            self._send_arm(tick.arm)
        commanded = _led_to(tick, tick.arm.tcp, self._scene.twist_lasts_s)
        self._send(self._commanded, wall_ns, BASE, commanded)

    def on_truth(self, truth: SceneTruth) -> None:
        """Send the poses of the rig's things."""
        wall_ns = truth.t_ns + self._offset_ns
        places = thing_frames(truth)
        moved = [transform(wall_ns, BASE, name, pose) for name, pose in places.items()]
        self._things.log(FrameTransforms(transforms=moved), log_time=wall_ns)

    def on_prediction(self, prediction: MountPrediction) -> None:
        """Send where the flange is believed to be, if it is time."""
        if not self._prediction_pace.is_due(prediction.now_ns):
            return
        wall_ns = prediction.now_ns + self._offset_ns
        moved = [transform(wall_ns, BASE, PREDICTED, prediction.now)]
        if prediction.commanded is not None:
            moved.append(transform(wall_ns, BASE, LED, prediction.commanded))
        self._predicted.log(FrameTransforms(transforms=moved), log_time=wall_ns)

    def _send_arm(self, arm: ArmState) -> None:
        wall_ns = arm.received_ns + self._offset_ns
        places = self._scene.arm_frames(arm)
        moved = [transform(wall_ns, BASE, name, pose) for name, pose in places.items()]
        self._arm.log(FrameTransforms(transforms=moved), log_time=wall_ns)
        joints = [
            JointState(name=name, position=angle) for name, angle in joint_angles(arm).items()
        ]
        message = JointStates(timestamp=timestamp(wall_ns), joints=joints)
        self._joints.log(message, log_time=wall_ns)

    def _send(self, channel: PoseInFrameChannel, wall_ns: int, frame: str, pose: Pose) -> None:
        message = PoseInFrame(timestamp=timestamp(wall_ns), frame_id=frame, pose=pose_of(pose))
        channel.log(message, log_time=wall_ns)


def joint_angles(arm: ArmState) -> dict[str, float]:
    """The reported angles [rad] by the joints' names, from the base on."""
    angles = arm.joints.tolist()
    return {f"joint{number}": angle for number, angle in enumerate(angles, start=1)}


def _led_to(tick: Tick, tcp: Pose, seconds: float) -> Pose:
    """The pose that the tick's twist takes the TCP to if no other command follows."""
    position = tcp.position + np.multiply(tick.twist.linear, seconds)
    turn = Rotation.from_rotvec(np.multiply(tick.twist.angular, seconds))
    return Pose(position, turn * tcp.rotation)
