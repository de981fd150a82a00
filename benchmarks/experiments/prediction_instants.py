"""Instants of a trial in virtual time, and what is believed of the arm at each when it is late."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hw.arms import arm_kind
from tams_app.config import Config
from tams_app.prediction.forward_model import ArmHeard, ForwardModel
from tams_app.prediction.trail import Trail
from tams_app.records import Tick, Vector
from tams_app.robot.build import ready_pose
from tams_app.session.virtual.videoless import VideolessTrial
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS

FRAME_MS, STATE_MS = 45.0, 5.0  # older than the one-way latency
_EACH_TICKS = 40
_SPEED_OVER = 5  # states, 60 a second: what they are extrapolated by
_WHOLE = 1 << 62


class Recorded(VideolessTrial):
    """A trial of which the renderer's state at each tick is kept."""

    def __init__(self, config: Config, seed: int) -> None:
        super().__init__(config, seed)
        self.world = Trail(_WHOLE)

    def on_tick(self, tick: Tick) -> None:
        super().on_tick(tick)
        self.world.add(self._robot.arm.simulated_ns, self._robot.qpos)


@dataclass(frozen=True, slots=True)
class Instant:
    """What is believed of the joints [rad] at a time, by the name of the belief."""

    now_ns: int
    frame_ns: int
    frame_joints: Vector
    believed: dict[str, Vector]
    closed: bool  # the gripper, by the newest state


def instants(config: Config, trial: Recorded, one_way_ms: float) -> Iterator[Instant]:
    """One each third of a second while the operator is engaged."""
    kind = arm_kind(config.arm.model)
    model = ForwardModel(config, kind.kinematics(config.arm), ready_pose(config).rotation)
    state_ns = round((one_way_ms + STATE_MS) * NS_PER_MS)
    frame_ns = round((one_way_ms + FRAME_MS) * NS_PER_MS)
    states, heard = trial.ticks[::2], 0  # of 120 ticks a second
    for number, tick in enumerate(trial.ticks):
        now_ns = tick.started_ns
        model.sent(tick.controller, now_ns)
        while states[heard].started_ns + state_ns <= now_ns:
            model.heard(_heard(states[heard]), 0)
            heard += 1
        forecast = model.at(now_ns)
        moves = tick.arming == ArmingState.ENGAGED and heard > _SPEED_OVER
        if forecast is None or not moves or number % _EACH_TICKS:
            continue
        newest, before = states[heard - 1], states[heard - 1 - _SPEED_OVER]
        joints, then = _joints(newest), _joints(before)
        share = (now_ns - _time(newest)) / (_time(newest) - _time(before))
        late = model.at(now_ns - frame_ns)
        assert late is not None
        yield Instant(
            now_ns,
            now_ns - frame_ns,
            late.joints,
            {
                "newest state": joints,
                "extrapolated": joints + (joints - then) * share,
                "forward model": forecast.joints,
                "true pose": trial.world.at(now_ns)[:6],
            },
            _closed(newest),
        )


def _heard(tick: Tick) -> ArmHeard:
    return ArmHeard(
        t_ns=_time(tick),
        joints=_joints(tick),
        until_ns=tick.started_ns,
        arming=ArmingState(tick.arming),
        orientation_mode=tick.orientation_mode,
        speed_scale=tick.speed_scale,
    )


def _closed(tick: Tick) -> bool:
    assert tick.arm is not None
    return bool(tick.arm.gripper_closed)


def _time(tick: Tick) -> int:
    assert tick.arm is not None
    return tick.arm.received_ns


def _joints(tick: Tick) -> Vector:
    assert tick.arm is not None
    return np.array(tick.arm.joints)
