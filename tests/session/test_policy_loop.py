"""When the policy steps, under a virtual clock; the thread around it is in test_parts."""

from __future__ import annotations

import pytest

from tams_app.capacity import ConstantCapacity
from tams_app.config import load_config
from tams_app.policy.allocation import make_strategy
from tams_app.policy.budget import OracleBudget
from tams_app.policy.engine import Policy
from tams_app.records import Allocation, Phase
from tams_app.runtime.clock import NS_PER_MS, VirtualClock
from tams_app.session.policy_loop import PolicyLoop

pytestmark = pytest.mark.waiting


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def applied() -> list[Allocation]:
    return []


@pytest.fixture
def loop(clock, applied) -> PolicyLoop:
    settings = load_config().policy
    budget = OracleBudget(ConstantCapacity(6000.0), settings.budget)
    policy = Policy(make_strategy("tams", settings), budget, settings)
    return PolicyLoop(clock, 20.0, policy, lambda now_ns: None, applied.append)


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
    loop.enter(Phase.ALIGN)
    loop.step_if_due()
    loop.step_if_due()
    assert loop.due_ns == start_ns + 60 * NS_PER_MS
    assert [one.phase for one in applied] == [Phase.REACH, Phase.ALIGN]


def test_a_standstill_is_made_up_for_once_and_not_for_each_period(loop, clock, applied):
    start_ns = clock.now_ns()
    step_at(loop, clock, 0, 500, 501, 502, 520, 551)
    assert [(one.t_ns - start_ns) / NS_PER_MS for one in applied] == [0, 500, 501, 551]
