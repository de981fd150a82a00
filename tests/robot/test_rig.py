"""The simulated rig through its processes, as a session has it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import load_config
from tams_app.records import Vector
from tams_app.robot.rig import SimulatedRig
from tams_app.rotation import Rotation
from tams_app.runtime.clock import MonotonicClock
from tams_app.vectors import floats
from tests.faults.applications import until

pytestmark = pytest.mark.waiting

DOWN = Rotation.from_rotvec((math.pi, 0.0, 0.0))


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[SimulatedRig]:
    rig = SimulatedRig(load_config(overrides={"rig.enabled": True}), MonotonicClock(), tmp_path)
    rig.start()
    try:
        rig.wait_ready()
        yield rig
    finally:
        rig.close()


def block(rig: SimulatedRig) -> Vector:
    truth = rig.truth()
    assert truth is not None
    return truth.block.position


def test_a_block_that_was_pushed_away_is_put_back_once_nothing_is_in_the_way(
    rig: SimulatedRig,
) -> None:
    model = Lite6Model(offset_from_mm_deg((0, 0, 82, 0, 0, 0)))
    arm = rig.make_arm()
    arm.connect()
    try:

        def goes(y: float, z: float) -> None:
            """The fingertips to a place beside the block's start [m]."""
            state = arm.state()
            assert state is not None
            place = np.array([start[0], start[1] + y, z])
            joints = model.approach(floats(place), DOWN.as_matrix(), state.joints, 60)
            assert joints is not None
            arm.begin_move_to_joints(list(joints), 0.6)
            until(lambda: is_there(joints), "the arm")

        def is_there(joints: tuple[float, ...]) -> bool:
            state = arm.state()
            return state is not None and bool(np.abs(state.joints - joints).max() < 0.002)

        start = block(rig)
        for y, z in ((-0.04, 0.08), (-0.04, 0.012), (-0.008, 0.012)):  # with the finger in front
            goes(y, z)
        assert np.linalg.norm(block(rig) - start) > 0.005
        rig.put_back()
        time.sleep(0.3)
        assert np.linalg.norm(block(rig) - start) > 0.005
        goes(-0.008, 0.08)
        until(lambda: bool(np.linalg.norm(block(rig) - start) < 0.001), "the block")
    finally:
        arm.close()
