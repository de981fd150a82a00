"""What the console shows, from what the threads told the board."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tams_app.capacity import ConstantCapacity
from tams_app.config import load_config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import (
    Allocation,
    ControllerSample,
    ControllerStatus,
    LatencyState,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    StopRecord,
)
from tams_app.robot.status import StatusBoard
from tams_app.teleop.safety import ArmingState, Reason
from tests.robot.test_parts import arm_at, output

pytestmark = pytest.mark.untimed

WEIGHTS = WeightMatrix(load_config().policy.weights.matrix)
UP = ControllerSample.released(ControllerStatus.OK)


NO_FRAMES = SimpleNamespace(age_ns=lambda view, now_ns: None)


def board_of(views):
    return StatusBoard(views, WEIGHTS, 30.0)


def state(board):
    return board.state(10**9, 1.0, NO_FRAMES, ConstantCapacity(6000.0), {"gt": 14.0}, "openvr")


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        ({}, ()),
        ({"grip": 0.9}, ("grip",)),
        ({"grip": 0.1}, ()),
        ({"a": True}, ("A",)),
        ({"b": True}, ("B",)),
        ({"menu": True}, ("menu",)),
        ({"grip": 1.0, "a": True, "b": True, "menu": True}, ("grip", "A", "B", "menu")),
    ],
)
def test_each_pressed_button_is_shown(change, shown):
    board = board_of(("gt",))
    assert state(board).pressed == ()
    board.on_tick(SimpleNamespace(controller=replace(UP, **change)))
    assert state(board).pressed == shown


@pytest.mark.parametrize("closed", [None, True, False])
def test_the_gripper_is_shown_as_the_arm_has_acknowledged_it(closed):
    board = board_of(("gt",))
    assert state(board).gripper_closed is None
    arm = replace(arm_at(0.3, 0), gripper_closed=closed)
    board.on_output(0, output(ArmingState.READY), arm)
    assert state(board).gripper_closed is closed


def test_what_its_frames_take_on_this_side_is_told_of_each_view():
    board, own = board_of(("gt", "gs")), LatencyState(12, "encoder", 9)
    told = board.state(
        10**9, 1.0, NO_FRAMES, ConstantCapacity(6000.0), {}, "openvr", latency={"gt": own}
    )
    assert (told.views["gt"].own, told.views["gs"].own) == (own, None)


def test_the_frames_that_each_camera_gives_are_shown():
    assert state(board_of(("gt",))).views["gt"].given_fps == 14.0
    assert state(board_of(("gs",))).views["gs"].given_fps is None


def packet(fate, kind=PacketKind.MEDIA):
    return PacketRecord("gt", kind, 0, 1000, 10**9, 10**9, 10**9, fate)


def test_loss_is_the_share_of_media_packets_that_did_not_arrive():
    board = board_of(("gt",))
    assert state(board).loss is None
    board.packets([packet(PacketFate.DELIVERED)] * 6)
    board.packets([packet(PacketFate.LOST), packet(PacketFate.OVERFLOW)])
    board.packets([packet(PacketFate.LOST, PacketKind.PADDING)] * 4)
    assert state(board).loss is None
    board.on_allocation(Allocation(10**9, Phase.REACH, 5000.0, 4600.0, {"gt": 4000}))
    assert state(board).loss == 0.25


def test_budget_and_estimate_are_those_of_the_last_allocation():
    board = board_of(("gt",))
    assert state(board).budget_kbps is None
    board.on_allocation(Allocation(0, Phase.REACH, 5000.0, 4600.0, {"gt": 4000}))
    shown = state(board)
    assert (shown.budget_kbps, shown.estimate_kbps) == (4600.0, 5000.0)
    assert shown.capacity_kbps == 6000.0
    board.on_allocation(Allocation(0, Phase.REACH, float("inf"), 4600.0, {"gt": 4000}))
    assert state(board).estimate_kbps is None


def test_the_last_stop_is_the_recorded_one_and_what_is_in_the_way_is_none():
    board = board_of(("gt",))
    board.on_output(10**8, output(ArmingState.READY, Reason.POSE_FROZEN), None)
    shown = state(board)
    assert (shown.reason, shown.last_stop) == ("pose frozen", "")
    assert (shown.heard_ns, shown.now_ns) == (10**8, 10**9)
    board.on_stop(StopRecord("stale video", 0, 10**8))
    board.on_output(2 * 10**8, output(ArmingState.READY), None)
    shown = state(board)
    assert (shown.reason, shown.last_stop) == ("", "stale video")


def test_the_block_is_placed_once_the_judge_has_seen_it():
    board = board_of(("eih",))
    assert not state(board).placed
    board.placed = True
    assert state(board).placed
