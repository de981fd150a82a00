"""What the operator's side would receive, where both sides are one process."""

from __future__ import annotations

import threading
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tams_app.config import Config, Network
from tams_app.recording import SessionLog, read_log
from tams_app.records import MountPrediction
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.session.predicting import Beliefs, LateStates, present_of
from tams_app.session.viewing import scene_of
from tams_app.units import NS_PER_MS
from tests.golden_logs import golden_log
from tests.session.exchange import Unkept
from tests.teleop.rig import PERIOD_NS

pytestmark = pytest.mark.waiting


@cache
def recorded() -> tuple[SessionLog, Config]:
    """From reach to transport."""
    log = read_log(golden_log("feedback"))
    return log, Config.model_validate(log.header.config)


def beliefs(found: list[MountPrediction]) -> Beliefs:
    mount: Any = SimpleNamespace(put=found.append, camera_fits=True)
    return Beliefs(mount, Unkept(VirtualClock()))


def told(network: Network) -> list[MountPrediction]:
    """Where the flange is believed to be, over that session."""
    log, config = recorded()
    found: list[MountPrediction] = []
    states = LateStates(present_of(config, beliefs(found)), network)
    for tick in log.ticks:
        states.receive(tick)
        states.step()
    return found


@pytest.mark.parametrize("latency_ms", [0.0, 100.0, 400.0])
def test_the_flange_is_believed_to_be_where_the_arm_has_it(latency_ms: float) -> None:
    log, config = recorded()
    figure = scene_of(config).figure
    assert figure is not None
    found = told(Network(latency_ms=latency_ms, jitter_ms=10.0))
    true = {tick.started_ns: tick.arm for tick in log.ticks}
    away_m, moved_m = [], []
    for placed in found:
        arm = true[placed.now_ns]
        assert arm is not None
        flange = figure.place(arm.joints)[figure.flange].position
        away_m.append(np.linalg.norm(placed.now.position - flange))
        moved_m.append(np.linalg.norm(placed.then.position - flange))
    assert np.percentile(away_m, 95) < 2e-3
    assert latency_ms == 0.0 or np.percentile(moved_m, 95) > 10 * np.percentile(away_m, 95)


def test_a_state_comes_as_late_as_the_network_makes_it_at_worst() -> None:
    found = told(Network(latency_ms=80.0, jitter_ms=15.0))
    late_ns = [placed.now_ns - placed.then_ns for placed in found]
    assert min(late_ns) >= 95 * NS_PER_MS
    assert max(late_ns) <= 95 * NS_PER_MS + 3 * PERIOD_NS


def test_the_control_thread_hands_over_and_another_one_works() -> None:
    log, config = recorded()
    found: list[MountPrediction] = []
    states = LateStates(present_of(config, beliefs(found)), Network())
    for tick in log.ticks[:60]:
        states.receive(tick)
    assert found == []
    stop = threading.Event()
    worker = threading.Thread(target=states.run, args=(stop, MonotonicClock()))
    worker.start()
    worker.join(0.3)
    stop.set()
    worker.join()
    assert len(found) >= 25  # each second tick
