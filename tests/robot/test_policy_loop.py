"""When the policy steps, and who hears of it."""

from __future__ import annotations

import math
import threading

import pytest

from tams_app.capacity import ConstantCapacity
from tams_app.config import load_config
from tams_app.policy.budget.sender import START_KBPS
from tams_app.records import (
    Allocation,
    PacketArrival,
    Phase,
    PhaseChange,
    PinnedView,
    PolicyInputs,
    Reception,
    Record,
    UplinkReport,
    UplinkSummary,
)
from tams_app.robot.listener import Listener
from tams_app.robot.policy_loop import PolicyLoop
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.waiting


class Encoders:
    """What the policy tells the encoders."""

    def __init__(self) -> None:
        self.capacity = ConstantCapacity(6000.0)
        self.targets: list[dict[str, int]] = []
        self.protected: list[dict[str, int]] = []
        self.arrivals: tuple[PacketArrival, ...] = ()
        self.receptions: tuple[Reception, ...] = ()
        self.padded: list[int] = []
        self.limits: list[float] = []
        self.sent_bytes = 0

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        self.targets.append(target_kbps)

    def bound_flight(
        self, limit_bytes: float, target_kbps: dict[str, int], capacity_kbps: float
    ) -> None:
        self.limits.append(limit_bytes)

    def protect(self, report: UplinkReport, target_kbps: dict[str, int]) -> None:
        self.protected.append(target_kbps)

    def pad(self, size_bytes: int) -> None:
        self.padded.append(size_bytes)

    def report(self, now_ns: int) -> UplinkReport:
        return UplinkReport(now_ns, self.sent_bytes, self.arrivals, self.receptions)


class Heard(Listener):
    """Allocations and reports in the order in which they came, and the capacity's times."""

    def __init__(self) -> None:
        self.allocations: list[Allocation] = []
        self.capacities_ns: list[int] = []
        self.summaries: list[UplinkSummary] = []
        self.inputs: list[PolicyInputs] = []
        self.arrived = threading.Event()

    def receive(self, record: Record) -> None:
        if isinstance(record, UplinkSummary):
            self.summaries.append(record)
        elif isinstance(record, PolicyInputs):
            self.inputs.append(record)
        elif isinstance(record, Allocation):
            self.allocations.append(record)
            if record.phase is Phase.ALIGN:
                self.arrived.set()

    def capacity(self, now_ns: int, capacity: object) -> None:
        self.capacities_ns.append(now_ns)


def began(phase: Phase) -> PhaseChange:
    return PhaseChange(0, phase, "the test says so")


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def encoders() -> Encoders:
    return Encoders()


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def applied(heard) -> list[Allocation]:
    return heard.allocations


@pytest.fixture
def loop(clock, encoders, heard) -> PolicyLoop:
    config = load_config(None, {"policy.budget.mode": "oracle"})
    return PolicyLoop(config, clock, encoders, heard, (heard,))


def step_at(loop, clock, *times_ms):
    start_ns = clock.now_ns()
    for t_ms in times_ms:
        clock.sleep_until_ns(start_ns + t_ms * NS_PER_MS)
        loop.step_if_due()


def test_it_steps_at_its_rate_and_not_between(loop, clock, applied):
    start_ns = clock.now_ns()
    step_at(loop, clock, 0, 20, 49, 50, 70, 100)
    assert [(one.t_ns - start_ns) / NS_PER_MS for one in applied] == [0, 50, 100]


def test_a_phase_that_begins_is_answered_at_once_and_the_period_counts_from_there(
    loop, clock, applied
):
    start_ns = clock.now_ns()
    step_at(loop, clock, 0)
    clock.advance_ns(10 * NS_PER_MS)
    loop.receive(began(Phase.ALIGN))
    loop.step_if_due()
    loop.step_if_due()
    assert loop.due_ns == start_ns + 60 * NS_PER_MS
    assert [one.phase for one in applied] == [Phase.REACH, Phase.ALIGN]


def test_a_standstill_is_made_up_for_once_and_not_for_each_period(loop, clock, applied):
    start_ns = clock.now_ns()
    step_at(loop, clock, 0, 500, 501, 502, 520, 551)
    assert [(one.t_ns - start_ns) / NS_PER_MS for one in applied] == [0, 500, 501, 551]


def test_the_encoders_have_the_targets_before_anything_else_hears_of_them(
    loop, clock, encoders, heard
):
    seen = []
    heard.receive = lambda record: seen.append(list(encoders.targets))
    loop.step_if_due()
    assert seen == [encoders.targets]
    assert len(encoders.targets) == 1
    assert heard.capacities_ns == [clock.now_ns()]


def test_the_budget_hears_what_the_video_reports(clock, encoders, heard):
    config = load_config(None, {"policy.budget.mode": "sender"})
    loop = PolicyLoop(config, clock, encoders, heard, (heard,))
    encoders.receptions = (Reception("eih", 0.5, None, 0),)
    for _ in range(22):
        loop.step_if_due()
        clock.advance_ns(50 * NS_PER_MS)
    assert heard.allocations[0].capacity_kbps == START_KBPS
    assert heard.allocations[-1].capacity_kbps < START_KBPS


def test_all_that_a_step_was_told_is_kept(clock, encoders, heard):
    loop = feedback_loop(clock, encoders, heard)
    encoders.arrivals = (PacketArrival("eih", 5, 1228, 9), PacketArrival("gt", 6, 300, None))
    encoders.receptions = (Reception("eih", 0.5, None, 0),)
    step_at(loop, clock, 0, 50, 100)
    assert len(heard.inputs) == 3
    assert [len(one.view) for one in heard.inputs] == [one.packets for one in heard.summaries]
    assert [one.t_ns for one in heard.inputs] == [one.t_ns for one in heard.allocations]


def test_the_oracle_is_told_nothing_that_is_worth_keeping(loop, heard):
    loop.step_if_due()
    assert heard.inputs == []


def test_a_phase_change_reaches_the_encoders_without_waiting_for_the_next_period(
    clock, encoders, heard
):
    config = load_config(None, {"policy.rate_hz": 1.0})
    loop, stop = PolicyLoop(config, clock, encoders, heard, (heard,)), threading.Event()
    thread = threading.Thread(target=loop.run, args=(stop,))
    thread.start()
    loop.receive(began(Phase.ALIGN))  # the clock stands: the next period never comes
    assert heard.arrived.wait(10)
    stop.set()
    loop.receive(began(Phase.REACH))
    thread.join(10)
    assert encoders.targets[-1]["eih"] > 0
    assert not thread.is_alive()


def test_what_the_budget_is_told_is_heard_in_each_step_that_is_told_anything(
    clock, loop, heard, encoders
):
    step_at(loop, clock, 0)
    assert heard.summaries == []
    encoders.sent_bytes = 700
    encoders.arrivals = (PacketArrival("eih", 10, 500, 40), PacketArrival("eih", 20, 200, None))
    step_at(loop, clock, 50)
    (summary,) = heard.summaries
    assert (summary.packets, summary.sent_bytes, summary.lost) == (2, 700, 1)


def feedback_loop(clock, encoders, heard):
    config = load_config(None, {"policy.budget.mode": "feedback"})
    return PolicyLoop(config, clock, encoders, heard, (heard,))


def test_padding_goes_in_short_trains_between_the_allocations(clock, encoders, heard):
    loop = feedback_loop(clock, encoders, heard)
    start_ns = clock.now_ns()
    encoders.arrivals = (PacketArrival("eih", start_ns - 40 * NS_PER_MS, 500, start_ns),)
    while clock.now_ns() < start_ns + 500 * NS_PER_MS:
        loop.step_if_due()
        assert loop.due_ns - clock.now_ns() <= 10 * NS_PER_MS
        clock.sleep_until_ns(loop.due_ns)
    assert len(heard.allocations) == 10
    assert len(encoders.padded) > 15
    assert 0 < max(encoders.padded) < 1.2 * max(one.capacity_kbps for one in heard.allocations) * 10


def test_a_phase_that_begins_brings_no_padding_forward(clock, encoders, heard):
    loop = feedback_loop(clock, encoders, heard)
    loop.step_if_due()
    due_ns = loop.due_ns
    loop.receive(began(Phase.ALIGN))
    loop.step_if_due()
    assert loop.due_ns == due_ns
    assert [one.phase for one in heard.allocations] == [Phase.REACH, Phase.ALIGN]


def test_each_step_tells_the_video_how_much_may_be_under_way(clock, encoders, heard, loop):
    loop.step_if_due()
    assert encoders.limits == [math.inf]  # the oracle's
    feedback_loop(clock, encoders, heard).step_if_due()
    assert 6000 <= encoders.limits[-1] < 50_000


def test_a_budget_that_sends_no_padding_is_not_asked_for_any(clock, loop, encoders):
    start_ns = clock.now_ns()
    loop.step_if_due()
    assert loop.due_ns == start_ns + 50 * NS_PER_MS
    clock.sleep_until_ns(loop.due_ns)
    loop.step_if_due()
    assert encoders.padded == []


def test_a_pinned_view_gets_the_bits_of_its_row_at_once_until_it_is_let_go(
    loop: PolicyLoop, clock: VirtualClock, applied: list[Allocation]
) -> None:
    step_at(loop, clock, 0)
    for view in ("eih", ""):
        clock.advance_ns(NS_PER_MS)
        loop.receive(PinnedView(clock.now_ns(), view))
        loop.step_if_due()
    assert [one.phase for one in applied] == [Phase.REACH, Phase.ALIGN, Phase.REACH]
    assert [one.target_kbps["eih"] for one in applied] == [1316, 3192, 1316]
