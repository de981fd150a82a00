"""A hand recorded in virtual time without any video: that of the demo's operator.

Its motion depends on neither frame nor network, so that every run that replays it
(`rig.hand_trajectory`) is asked for the same motion. Everything between hand and arm is the
product's. A recording takes some eight seconds of a core.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hw.sim.layout import BLOCK_EDGE_M, draw_layout
from hw.sim.operator.demo import demo_controller
from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.recording import read_ticks
from tams_app.recording.journal import DirectRecorder
from tams_app.recording.mcap_log import McapLog
from tams_app.records import Outcome, Pose, Record, SceneTruth, Tick
from tams_app.robot import build
from tams_app.robot.control import LoopDevices, Signals, SteadyVideo
from tams_app.robot.engine import RecordedSteps
from tams_app.robot.listener import Listener
from tams_app.robot.trial import task_geometry
from tams_app.runtime.clock import VirtualClock
from tams_app.session.recorders import session_header
from tams_app.session.virtual.side import VirtualRobot
from tams_app.task.judge import TrialJudge
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

_START_NS = NS_PER_S
_AFTERWARDS_NS = 2 * NS_PER_S  # the hand rests so long after the block was placed
_LONGEST_S = 90.0
_TURN_RAD = (0.45, -0.45)  # from the block's place to the other one, about the arm's base
_BEYOND_AZIMUTH_RAD = -0.4  # from where the first of them leads clear of the container
_THERE_M = 0.03


@dataclass(frozen=True, slots=True)
class Waits:
    """When the operator sees the scene, in seconds from the first reading: what a replay waits for.

    From `confirm_s` for half a second, in which they begin to confirm the arming, and from
    `squeeze_s` on.
    """

    confirm_s: float = 0.0
    squeeze_s: float = 2.0

    def sees(self, since_s: float) -> bool:
        return self.confirm_s <= since_s < self.confirm_s + 0.5 or since_s >= self.squeeze_s


# A live session's first frames come after its first tick, and its arm takes a second or two to
# release the brakes.
LIVE = Waits(confirm_s=3.0, squeeze_s=9.0)


def record_hand(config: Config, path: Path, waits: Waits | None = None) -> Outcome:
    """Record the demo's operator on the scene of `config.seed`; TamsError if they fail.

    `waits` None: they begin at once, for replays in virtual time.
    """
    header = session_header(config, _START_NS, 0)
    clock = VirtualClock(_START_NS)
    file = McapLog(path, header, min_free_mb=config.recording.min_free_mb)
    with closing(DirectRecorder(file, clock)) as log:
        recording = _Recording(config, clock, log, waits or Waits())
        try:
            outcome = recording.run()
        finally:
            recording.close()
    if not outcome.success:
        raise TamsError(f"seed {config.seed}: the scripted operator failed ({outcome.reason})")
    return outcome


def record_carrying(config: Config, path: Path, seconds: float) -> None:
    """Record the demo's operator carrying the block to and fro on the table for `seconds`.

    Every carry has all phases of the task, and no trial ends by it.
    """
    header = session_header(config, _START_NS, 0)
    clock = VirtualClock(_START_NS)
    file = McapLog(path, header, min_free_mb=config.recording.min_free_mb)
    with closing(DirectRecorder(file, clock)) as log:
        recording = _Recording(config, clock, log, Waits(), ToAndFro(config.seed))
        try:
            recording.run(seconds)
        finally:
            recording.close()


class ToAndFro:
    """The scene as an operator sees it for whom the container is at another place of the table.

    That is where the block does not lie: as soon as it is let go at one, they mean the other.
    """

    def __init__(self, seed: int) -> None:
        block = draw_layout(seed).block
        here = np.array([block.x, block.y])
        azimuth = np.arctan2(block.y, block.x)
        turn = _TURN_RAD[0] if azimuth < _BEYOND_AZIMUTH_RAD else _TURN_RAD[1]
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        self._places = [turned @ here, here]

    def see(self, truth: SceneTruth) -> SceneTruth:
        away = np.linalg.norm(truth.block.position[:2] - self._places[0])
        if away < _THERE_M and truth.fingers_opening > BLOCK_EDGE_M + 0.001:
            self._places.reverse()
        where = np.array([*self._places[0], truth.container.position[2]])
        return replace(truth, container=Pose(where, truth.container.rotation))


class _Recording(Listener):
    """The rig of a recording: a robot and a hand, no cameras."""

    def __init__(
        self,
        config: Config,
        clock: VirtualClock,
        log: DirectRecorder,
        waits: Waits,
        to_and_fro: ToAndFro | None = None,
    ) -> None:
        self._clock = clock
        self._waits = waits
        self._to_and_fro = to_and_fro
        self._period_ns = round(NS_PER_S / config.control.rate_hz)
        self._robot = robot = VirtualRobot(config, clock, lambda _level, _text: None)
        self._judge = TrialJudge(config.trial, task_geometry())
        controller = demo_controller(config, self._see)
        self._loop = build.control_loop(
            config,
            clock,
            LoopDevices(controller, robot.arm, robot.gate, SteadyVideo()),
            0,
            Signals(),
            (self, RecordedSteps(log)),
        )
        robot.arm.connect()
        controller.start()

    def run(self, longest_s: float = _LONGEST_S) -> Outcome:
        """Until the block has lain in the container for a while, or nothing comes of it."""
        end_ns = _START_NS + round(longest_s * NS_PER_S)
        placed_ns: int | None = None
        while self._clock.now_ns() < end_ns:
            self._clock.advance_ns(self._period_ns)
            self._loop.tick(self._clock.now_ns())
            self._robot.gate.serve()
            now_ns, arm = self._clock.now_ns(), self._robot.arm.state()
            closed = arm.gripper_closed if arm is not None else None
            if placed_ns is None and self._judge.step(now_ns, self._robot.truth(), closed):
                placed_ns, end_ns = now_ns, now_ns + _AFTERWARDS_NS
        return self._judge.outcome()

    def close(self) -> None:
        self._robot.stop()
        self._robot.arm.close()

    def _see(self) -> SceneTruth | None:
        since_s = (self._clock.now_ns() - _START_NS) / NS_PER_S
        if not self._waits.sees(since_s):
            return None
        truth = self._robot.truth()
        return truth if self._to_and_fro is None else self._to_and_fro.see(truth)

    def receive(self, record: Record) -> None:
        if isinstance(record, Tick) and record.arming == ArmingState.ENGAGED.value:
            self._judge.engaged(record.started_ns)


@dataclass(frozen=True, slots=True)
class HandSpan:
    """When the hand first squeezes and when its recording ends [ns from the first reading]."""

    squeeze_ns: int
    end_ns: int

    @staticmethod
    def of(path: Path, engage_above: float) -> HandSpan:
        """Of the recording at `path`; TamsError if it never squeezes."""
        ticks = list(read_ticks(path))
        for tick in ticks:
            if tick.controller.trigger >= engage_above:
                first_ns = ticks[0].started_ns
                return HandSpan(tick.started_ns - first_ns, ticks[-1].started_ns - first_ns)
        raise TamsError(f"{path}: the hand never squeezes")
