"""What the robot's side shows, from its newest records and what it measures besides."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tams_app.config import load_config
from tams_app.records import (
    Allocation,
    CameraRates,
    LatencyState,
    LinkCapacity,
    Newest,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
    Placed,
    Record,
    SessionState,
    StopRecord,
)
from tams_app.robot.status import StatusBoard
from tams_app.units import NS_PER_S
from tests.robot.test_parts import arm_at
from tests.synthetic_session import tick

pytestmark = pytest.mark.untimed

NO_FRAMES = SimpleNamespace(age_ns=lambda view, now_ns: None)


class Shown:
    """A board, and the records that it is made from."""

    def __init__(self, *records: Record) -> None:
        self.newest = Newest(records)
        self.board = StatusBoard(load_config(), self.newest)

    def state(self, **measured: object) -> SessionState:
        return self.board.state(NS_PER_S, 1.0, NO_FRAMES, "openvr", **measured)


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
def test_each_pressed_button_is_shown(change: dict[str, object], shown: tuple[str, ...]) -> None:
    up = tick(0)
    assert Shown().state().pressed == Shown(up).state().pressed == ()
    pressed = replace(up, controller=replace(up.controller, **change))
    assert Shown(pressed).state().pressed == shown


@pytest.mark.parametrize("closed", [None, True, False])
def test_the_gripper_is_shown_as_the_arm_has_acknowledged_it(closed: bool | None) -> None:
    assert Shown().state().gripper_closed is None
    arm = replace(arm_at(0.3, 0), gripper_closed=closed)
    assert Shown(replace(tick(0), arm=arm)).state().gripper_closed is closed


def test_what_its_frames_take_on_this_side_is_shown_of_each_view() -> None:
    own = LatencyState(12, "encoder", 9)
    views = Shown().state(latency={"gt": own}).views
    assert (views["gt"].own, views["gs"].own) == (own, None)


def test_the_frames_that_each_camera_gives_are_shown() -> None:
    views = Shown(CameraRates(0, {"gt": 14.0}, {})).state().views
    assert (views["gt"].given_fps, views["gs"].given_fps) == (14.0, None)


def packet(fate: PacketFate, kind: PacketKind = PacketKind.MEDIA) -> PacketRecord:
    return PacketRecord("gt", kind, 0, 1000, NS_PER_S, NS_PER_S, NS_PER_S, fate)


def test_loss_is_the_share_of_media_packets_that_did_not_arrive() -> None:
    shown = Shown()
    assert shown.state().loss is None
    shown.board.packets([packet(PacketFate.DELIVERED)] * 6)
    shown.board.packets([packet(PacketFate.LOST), packet(PacketFate.OVERFLOW)])
    shown.board.packets([packet(PacketFate.LOST, PacketKind.PADDING)] * 4)
    assert shown.state().loss is None
    shown.board.receive(Allocation(NS_PER_S, Phase.REACH, 5000.0, 4600.0, {"gt": 4000}))
    assert shown.state().loss == 0.25


def test_budget_estimate_and_capacity_are_the_newest_and_no_limit_is_none() -> None:
    assert Shown().state().budget_kbps is None
    allocation = Allocation(0, Phase.REACH, 5000.0, 4600.0, {"gt": 4000})
    state = Shown(allocation, LinkCapacity(0, 6000.0)).state()
    assert (state.budget_kbps, state.estimate_kbps) == (4600.0, 5000.0)
    assert state.capacity_kbps == 6000.0
    assert (state.views["gt"].target_kbps, state.views["gs"].target_kbps) == (4000, None)
    endless = float("inf")
    unlimited = Shown(replace(allocation, capacity_kbps=endless), LinkCapacity(0, endless)).state()
    assert (unlimited.estimate_kbps, unlimited.capacity_kbps) == (None, None)


def test_the_last_stop_is_the_recorded_one_and_what_is_in_the_way_is_none() -> None:
    held = replace(tick(0), arming="ready", reason="pose frozen", started_ns=10**8)
    shown = Shown(held)
    state = shown.state()
    assert (state.reason, state.last_stop) == ("pose frozen", "")
    assert (state.heard_ns, state.now_ns) == (10**8, NS_PER_S)
    shown.newest.put(StopRecord("stale video", 0, 10**8))
    shown.newest.put(replace(held, reason=""))
    state = shown.state()
    assert (state.reason, state.last_stop) == ("", "stale video")


def test_the_primary_view_is_the_phases_or_the_pinned_one() -> None:
    start = PhaseChange(0, Phase.REACH, "start")
    assert (Shown().state().primary_view, Shown().state().phase) == ("", "")
    state = Shown(start).state()
    assert (state.phase, state.primary_view, state.is_pinned) == ("REACH", "gt", False)
    state = Shown(start, PinnedView(0, "gs")).state()
    assert (state.primary_view, state.is_pinned) == ("gs", True)


def test_the_block_is_placed_once_the_judge_has_seen_it() -> None:
    assert not Shown().state().placed
    assert Shown(Placed(0, placed=True)).state().placed
    assert not Shown(Placed(0, placed=False)).state().placed, "it was put back"
