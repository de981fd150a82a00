"""What the operator's side tells its prediction of an arm at the other end of a link."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from tams_app.link.gateway_client import Received
from tams_app.link.messages import HandMessage, StateMessage, decode, encode
from tams_app.prediction.forward_model import ArmHeard
from tams_app.records import ControllerSample, SessionState, SteeredBy
from tams_app.runtime.clock import VirtualClock
from tams_app.station.linked_robot import LinkedRobot, Requests, RobotFrames
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.session.exchange import called

pytestmark = pytest.mark.untimed

OFFSET_NS = 3_000_000_000_000  # the robot's clock minus ours
JOINTS = np.radians([10.0, 20.0, 30.0, -10.0, 5.0, 90.0])
TICK_NS = 8_333_333


class Present:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.samples: list[tuple[ControllerSample, int]] = []
        self.states: list[tuple[ArmHeard, int, int]] = []

    def sent(self, sample: ControllerSample, now_ns: int) -> None:
        self.samples.append((sample, now_ns))

    def heard(self, state: ArmHeard, way_ns: int, offset_ns: int = 0, closed: bool = False) -> None:
        self.states.append((state, way_ns, offset_ns))
        self.closed = closed


class Link:
    """A gateway to a robot's side that answers what it is sent, `way_ms` and `back_ms` later."""

    def __init__(self, way_ms: float, back_ms: float, **state: Any) -> None:
        self.clock, self.present = VirtualClock(NS_PER_S), Present()
        self._way_ns, self._back_ns = round(way_ms * NS_PER_MS), round(back_ms * NS_PER_MS)
        self._state, self._coming = state, []
        self.session = 1
        self.event = SimpleNamespace(connected=True, left=False, counts={}, address="")
        self.robot = LinkedRobot(
            self.clock,
            called(self, "keyboard"),
            Requests(),
            SimpleNamespace(record=lambda _: None, note=lambda *_: None),  # type: ignore[arg-type]
            SimpleNamespace(steered_by=lambda _view: SteeredBy()),  # type: ignore[arg-type]
            RobotFrames(()),
            self.present,  # type: ignore[arg-type]
        )

    def receive(self) -> list[Received]:
        now_ns = self.clock.now_ns()
        due = [one for one in self._coming if one[0] <= now_ns]
        self._coming = [one for one in self._coming if one[0] > now_ns]
        return [Received(at_ns, self.session, content) for at_ns, content in due]

    def send(self, content: bytes) -> None:
        hand = decode(content, HandMessage)
        there_ns = hand.sent_ns + self._way_ns + OFFSET_NS
        state = msgspec.structs.replace(
            SessionState(t_s=1.0, arming="engaged"),
            **{"joints_urad": tuple(np.rint(JOINTS * 1e6).astype(int).tolist()), **self._state},
            joints_ns=there_ns - 2 * NS_PER_MS,
        )
        message = StateMessage(
            there_ns, hand.sent_ns, there_ns, state, (), 0, "", 0, 0, 0, (), "", False
        )
        self._coming.append((hand.sent_ns + self._way_ns + self._back_ns, encode(message)))

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.clock.advance_ns(TICK_NS)
            self.robot.step()


def test_each_sample_that_is_sent_is_told_and_each_state_on_our_clock() -> None:
    link = Link(30.0, 50.0, orientation_mode=True, speed_scale=0.5, gripper_closed=True)
    link.run(60)
    assert link.present.closed
    assert len(link.present.samples) == 60
    state, way_ns, offset_ns = link.present.states[-1]
    assert state.joints == pytest.approx(JOINTS, abs=1e-6)
    assert state.arming is ArmingState.ENGAGED
    assert state.orientation_mode
    assert state.speed_scale == 0.5
    # the clocks are known within half the round trip, and where both ways are alike, exactly
    assert abs(offset_ns - OFFSET_NS) <= 40 * NS_PER_MS
    assert way_ns + (offset_ns - OFFSET_NS) == pytest.approx(30 * NS_PER_MS, abs=TICK_NS)
    assert state.t_ns + offset_ns == pytest.approx(
        link.present.samples[-1][1] + OFFSET_NS - 52 * NS_PER_MS, abs=2 * TICK_NS
    )


def test_a_link_that_is_made_anew_has_a_way_of_its_own():
    link = Link(300.0, 300.0)
    link.run(150)
    link._coming.clear()
    link._way_ns = link._back_ns = 20 * NS_PER_MS
    link.session = 2
    link.run(12)
    _, way_ns, offset_ns = link.present.states[-1]
    assert way_ns + offset_ns - OFFSET_NS == pytest.approx(20 * NS_PER_MS, abs=2 * TICK_NS)


def test_a_state_speaks_for_samples_that_its_tick_certainly_had() -> None:
    link = Link(30.0, 30.0)
    link.run(60)
    state, _, offset_ns = link.present.states[-1]
    assert state.until_ns is not None
    sent_ns = state.t_ns + offset_ns - OFFSET_NS + 2 * NS_PER_MS - 30 * NS_PER_MS
    assert sent_ns - 3 * TICK_NS < state.until_ns < sent_ns - TICK_NS


@pytest.mark.parametrize(
    "state",
    [{"joints_urad": ()}, {"joints_urad": (1, 2, 3)}, {"arming": "starting"}],
    ids=["no joints", "joints of another arm", "no tick yet"],
)
def test_what_says_nothing_of_the_arm_is_left_out(state: dict[str, Any]) -> None:
    link = Link(30.0, 30.0, **state)
    link.run(60)
    assert link.present.states == []
    assert len(link.present.samples) == 60
