from __future__ import annotations

import numpy as np
import pytest

from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER
from hw.sim.layout import BLOCK_EDGE_M, draw_layout
from hw.sim.world.world import World
from tests.hw.sim.operator.scripted_pick import ARM, CYCLE_NS, READY, ScriptedPick

pytestmark = pytest.mark.untimed


def test_tcp_is_where_the_controllers_kinematics_say() -> None:
    random = np.random.default_rng(5)
    for _ in range(8):
        joints = random.uniform(JOINT_LOWER, JOINT_UPPER)
        tcp, expected = World(draw_layout(0), joints).truth(0).tcp, ARM.tcp_pose(joints)
        assert np.linalg.norm(tcp.position - expected.position) < 1e-6
        assert (tcp.rotation.inv() * expected.rotation).magnitude() < 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_contact_grasp_lifts_holds_carries_and_places_the_block(seed: int) -> None:
    layout = draw_layout(seed)
    hand = ScriptedPick(World(layout, READY))
    hand.pick(layout)
    assert hand.block_height() > 0.09
    assert 0.9 * BLOCK_EDGE_M < hand.world.truth(0).fingers_opening < BLOCK_EDGE_M
    hand.grip(True, 0.5)
    before = hand.block_height()
    hand.grip(True, 3.0)
    assert abs(hand.block_height() - before) < 5e-5  # it does not creep out of the fingers
    hand.place(layout)
    assert hand.block_in_container()
    assert not hand.collided
    assert hand.tracking_error_m < 0.001


def test_block_and_container_stand_where_the_layout_says() -> None:
    layout = draw_layout(3)
    truth = World(layout, READY).truth(42)
    assert truth.t_ns == 42
    assert truth.block.position[:2] == pytest.approx([layout.block.x, layout.block.y])
    assert truth.container.position[:2] == pytest.approx([layout.container.x, layout.container.y])
    assert truth.block.rotation.as_rotvec()[2] == pytest.approx(layout.block.yaw)
    assert truth.container.rotation.as_rotvec()[2] == pytest.approx(layout.container.yaw)


def test_fingers_open_sixteen_millimetres_close_fully_and_rest_when_off() -> None:
    world = World(draw_layout(0), READY)

    def drive(gripper: bool | None) -> float:
        for _ in range(200):
            world.step(READY, gripper, CYCLE_NS)
        return world.truth(0).fingers_opening

    assert drive(True) < 0.0005
    assert drive(False) == pytest.approx(0.016, abs=1e-4)
    assert drive(None) == pytest.approx(0.016, abs=1e-4)


def test_pressing_on_the_table_reads_as_a_collision() -> None:
    hand = ScriptedPick(World(draw_layout(0), READY))
    hand.move([0.35, 0.0, 0.020], 0.0)
    assert not hand.collided
    hand.move([0.35, 0.0, -0.010], 0.0, 0.05)
    assert hand.collided


def test_fast_free_motion_and_sudden_stops_read_as_no_collision() -> None:
    world, target, collided = World(draw_layout(0), READY), READY.copy(), False
    for cycle in range(200):
        if cycle < 100:
            target = target + np.array([0.006, -0.002, 0.002, 0.0, 0.0, 0.006])
        collided |= world.step(target, None, CYCLE_NS).collision
    assert not collided
    assert world.joints == pytest.approx(target, abs=1e-3)


@pytest.mark.parametrize("duration_ns", [0, -CYCLE_NS, 1_500_000])
def test_durations_other_than_whole_milliseconds_are_refused(duration_ns: int) -> None:
    world = World(draw_layout(0), READY)
    with pytest.raises(ValueError, match="multiple"):
        world.step(READY, None, duration_ns)


def test_the_block_is_put_back_out_of_the_gripper_and_out_of_the_container() -> None:
    layout = draw_layout(1)
    hand = ScriptedPick(World(layout, READY))
    start = hand.world.truth(0)
    hand.pick(layout)
    assert hand.world.put_back()
    hand.grip(True, 0.5)
    truth = hand.world.truth(0)
    assert truth.block.position == pytest.approx(start.block.position, abs=5e-4)
    assert truth.fingers_opening < 0.001  # on nothing
    hand.pick(layout)
    hand.place(layout)
    assert hand.block_in_container()
    assert hand.world.put_back()
    truth = hand.world.truth(0)
    assert truth.block.position == pytest.approx(start.block.position, abs=1e-6)
    assert (truth.block.rotation.inv() * start.block.rotation).magnitude() < 1e-6
    assert not hand.collided


def test_the_block_stays_where_it_is_while_the_gripper_stands_at_its_start() -> None:
    layout = draw_layout(1)
    hand = ScriptedPick(World(layout, READY))
    start = hand.world.truth(0).block.position
    x, y = layout.block.x, layout.block.y
    hand.move([x + 0.03, y, 0.06], 0.0)
    hand.move([x + 0.03, y, 0.015], 0.0)
    hand.grip(True)
    hand.move([x, y, 0.015], 0.0)  # pushes it away
    before = hand.world.qpos
    assert not hand.world.put_back()
    assert np.array_equal(hand.world.qpos, before)
    hand.move([x, y, 0.06], 0.0)
    assert np.linalg.norm(hand.world.truth(0).block.position - start) > 0.005
    assert hand.world.put_back()
    assert hand.world.truth(0).block.position == pytest.approx(start, abs=1e-6)
