"""The whole task by keyboard: a person at the window presses keys, and the block is placed.

They know where things are: what is tried is the hand, not the eyes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hw.controller import Controller
from hw.desk.keyboard import CLOSE, DEADMAN, MODE, OPEN, HeldKeys, KeyboardController
from tams_app.config import Config
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Pose, SceneTruth
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.trial import START_NS, VirtualTrial
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.session.virtual.runs import PARTICIPANT, WALL_NS, short

pytestmark = [pytest.mark.untimed, pytest.mark.verify, pytest.mark.timeout(600)]

OPPOSITE = ("ws", "ad", "rf")  # forward, left, up
NEAR_M, NEAR_RAD = 0.012, math.radians(6.0)  # from there on keys are tapped
TAP_NS, LOOK_NS = 24 * NS_PER_MS, 160 * NS_PER_MS
TRAVEL_Z_M, GRASP_Z_M, RELEASE_Z_M = 0.12, 0.0105, 0.030
Keys = frozenset[str]
NO_KEYS: Keys = frozenset()
Target = tuple[float, float, float]


class Person:
    """Steps through the task; each step yields what is held until the next look."""

    def __init__(self, truth: Callable[[], SceneTruth]) -> None:
        self._truth = truth

    def work(self) -> Iterator[Keys]:
        yield from self._goes(lambda: self._at("block", TRAVEL_Z_M), 0.001)
        yield from self._turns()
        yield from self._goes(lambda: self._at("block", GRASP_Z_M), 0.001)
        yield from self._presses(CLOSE)
        lifted = self._at("tcp", TRAVEL_Z_M)
        yield from self._goes(lambda: lifted, 0.01)
        yield from self._goes(lambda: self._at("container", TRAVEL_Z_M), 0.005)
        yield from self._goes(lambda: self._at("container", RELEASE_Z_M), 0.005)
        yield from self._presses(OPEN)
        retreat = self._at("tcp", TRAVEL_Z_M)
        yield from self._goes(lambda: retreat, 0.01)
        while True:
            yield NO_KEYS

    def _goes(self, target: Callable[[], Target], tolerance_m: float) -> Iterator[Keys]:
        while True:
            errors: list[float] = (np.array(target()) - self._scene.tcp.position).tolist()
            if max(map(abs, errors)) < tolerance_m:
                return
            yield from _holds_or_taps(errors, tolerance_m, NEAR_M)

    def _turns(self) -> Iterator[Keys]:
        """About the vertical, in the other mode, until the fingers are along the block's sides."""
        yield from self._presses(MODE)
        tolerance_rad = math.radians(1.5)
        while abs(error := self._turn_left) > tolerance_rad:
            yield from _holds_or_taps([0.0, 0.0, error], tolerance_rad, NEAR_RAD)
        yield from self._presses(MODE)

    def _presses(self, key: str) -> Iterator[Keys]:
        yield from [frozenset({key})] * (100 * NS_PER_MS // TAP_NS)
        yield from [NO_KEYS] * (1500 * NS_PER_MS // TAP_NS)

    @property
    def _scene(self) -> SceneTruth:
        return self._truth()

    def _at(self, what: str, z_m: float) -> Target:
        x, y, _ = getattr(self._scene, what).position.tolist()
        return x, y, z_m

    @property
    def _turn_left(self) -> float:
        """To the nearest of the block's four sides [rad], counter-clockwise from above."""
        scene = self._scene
        turn = _heading(scene.block) - _heading(scene.tcp)
        quarter = math.pi / 2
        return (turn + quarter / 2) % quarter - quarter / 2


def _heading(pose: Pose) -> float:
    x, y, _ = pose.rotation.as_matrix()[:, 0]
    return math.atan2(y, x)


def _holds_or_taps(errors: list[float], tolerance: float, near: float) -> Iterator[Keys]:
    keys = {
        pair[error < 0.0]
        for error, pair in zip(errors, OPPOSITE, strict=True)
        if abs(error) >= tolerance
    }
    yield frozenset(keys)
    if max(map(abs, errors)) < near:
        yield from [NO_KEYS] * (LOOK_NS // TAP_NS)


class KeyboardOperator(VirtualOperator):
    """An operator who holds the keyboard and knows where things are, once `told`."""

    def __init__(self, config: Config, *arguments: Any) -> None:
        super().__init__(config, *arguments)
        self._keyboard = KeyboardController(config.controller.desk, config.hand.rotation)
        self._keys, self._next_ns = NO_KEYS, START_NS + 2 * NS_PER_S

    def told(self, truth: Callable[[], SceneTruth], confirm: Callable[[int], None]) -> None:
        self._work, self._confirm = Person(truth).work(), confirm

    def take_controller(self) -> Controller:
        self._keyboard.start()
        return self._keyboard

    def look(self, now_ns: int) -> None:
        if now_ns - START_NS < NS_PER_S:
            self._confirm(now_ns)
        elif now_ns >= self._next_ns:
            self._keys = next(self._work) | {DEADMAN}
            self._next_ns = now_ns + TAP_NS
        self._keyboard.feed(HeldKeys(self._keys, True, now_ns))


def test_the_block_is_placed_by_keyboard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tams_app.session.virtual.trial.VirtualOperator", KeyboardOperator)
    config = short(network="none", seconds=120, seed=3)
    with closing(VirtualTrial(config, PARTICIPANT, tmp_path, WALL_NS)) as trial:
        operator, robot = trial._operator, trial._robot
        assert isinstance(operator, KeyboardOperator)
        operator.told(robot._robot.truth, robot._engine.control._signals.confirm)
        outcome = trial.run()
    assert (outcome.success, outcome.drops) == (True, 0), outcome
    assert ArmingState.FAULT not in {tick.arming for tick in read_log(tmp_path / LOG_NAME).ticks}
