"""A real session of this checkout, measured from outside."""

from __future__ import annotations

import pytest

from benchmarks.checkouts import Checkout, Setting, run_session
from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.timed


def test_a_session_is_told_apart_by_thread_and_process() -> None:
    cost = run_session(Checkout.at(PROJECT_DIRECTORY), Setting(seed=1, fps=5, seconds=9))
    assert cost.profile.threads.keys() >= {"control", "main", "capture", "arm-report", "recorder"}
    assert cost.profile.helpers.keys() >= {"rig", "renderer", "relay", "guard", "quality"}
    assert None not in cost.measures.values()
    assert all(value >= 0 for value in cost.measures.values() if value is not None)


def test_a_session_that_cannot_start_says_why() -> None:
    checkout = Checkout(PROJECT_DIRECTORY, "", frozenset())
    with pytest.raises(RuntimeError, match=r"exit code 2: .*no_such_network"):
        run_session(checkout, Setting(seed=1, fps=5, seconds=9, network="no_such_network"))
