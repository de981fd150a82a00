"""The eyes alone, on images of the rig; whole trials are `python -m benchmarks.operator`."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.operator_rig import OperatorRig
from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.seeing import Reliance, SeeingPerception
from hw.sim.operator.task import Stage
from tams_app.config import DEFAULT_CONFIG, load_config
from tams_app.records import Image
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

SEED = 5
TICK_NS = 8 * NS_PER_MS


def _rig(**conditions) -> OperatorRig:
    config = load_config(DEFAULT_CONFIG).model_copy(update={"seed": SEED})
    return OperatorRig(config, participant=3, **conditions)


def _reach(rig: OperatorRig, seconds: float) -> float:
    """Seconds until the operator is over the block; `seconds` when he does not get there."""
    start_ns = rig.now_ns
    while rig.operator.stage is Stage.REACH and rig.now_ns - start_ns < seconds * NS_PER_S:
        rig.tick()
    return (rig.now_ns - start_ns) / NS_PER_S


def _blurred(view: str, image: Image) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 4.0))


@pytest.fixture(scope="module")
def reaches():
    """How long he takes to get over the block, and his rig, by condition."""
    conditions = {
        "clear": ({}, 15.0),
        "late": ({"delay_ms": 200.0}, 15.0),
        "blurred": ({"distort": _blurred}, 3.0),  # long enough to look, before he moves
    }
    results = {}
    for name, (condition, seconds) in conditions.items():
        rig = _rig(**condition)
        try:
            results[name] = (_reach(rig, seconds), rig)
        finally:
            rig.close()
    return results


def test_on_clear_images_he_gets_over_the_block_and_knows_where_it_is(reaches):
    seconds, rig = reaches["clear"]
    assert seconds < 12.0
    seen = rig.watched[-1]
    assert np.linalg.norm((seen.believed_gap - seen.true_gap)[:2]) < 0.004
    assert seen.reliance.block_sigma < 0.002


def test_blurred_images_make_him_less_certain(reaches):
    sigmas = {
        name: float(np.median([seen.reliance.block_sigma for seen in rig.watched[10:25]]))
        for name, (_, rig) in reaches.items()
    }
    assert sigmas["blurred"] > 1.5 * sigmas["clear"]


def test_late_images_are_noticed_as_lag_and_cost_time(reaches):
    lags = {name: rig.watched[-1].reliance.lag_ns for name, (_, rig) in reaches.items()}
    assert lags["late"] - lags["clear"] == pytest.approx(200 * NS_PER_MS, abs=80 * NS_PER_MS)
    assert reaches["late"][0] > reaches["clear"][0]


def test_each_glance_tells_how_much_each_view_gave(reaches):
    told = [seen.reliance for seen in reaches["clear"][1].watched]
    assert all(abs(sum(one.to_block.values()) - 1.0) < 1e-9 for one in told if one.to_block)
    assert {view for one in told for view in one.to_block} == {"eih", "gt", "gs"}


def test_the_same_images_and_seed_give_the_same_percepts():
    runs = []
    for _ in range(2):
        rig = _rig()
        try:
            for _ in range(60):
                rig.tick()
            runs.append([(seen.reliance, tuple(seen.believed_gap)) for seen in rig.watched])
        finally:
            rig.close()
    assert len(runs[0]) > 4
    assert runs[0] == runs[1]


class Station:
    """Eyes before images that a test puts on the screen."""

    def __init__(self) -> None:
        self.rig = _rig()
        for _ in range(30):
            self.rig.tick()
        self.live = dict(self.rig._screen.images())
        self.screen: dict[str, Image | None] = dict(self.live)
        self.asked = EfferenceCopy()
        self.told: list[Reliance] = []
        self.looks = 0
        self.eyes = SeeingPerception(self._images, self.asked, 0.08, 0.12, self.told.append)
        self.now_ns = NS_PER_S

    def _images(self) -> dict[str, Image | None]:
        self.looks += 1
        return self.screen

    def run(self, seconds: float, speed_m_s: float = 0.0) -> None:
        for _ in range(round(seconds * NS_PER_S / TICK_NS)):
            self.now_ns += TICK_NS
            moved = np.array([0.0, speed_m_s * TICK_NS / NS_PER_S, 0.0])
            self.asked.add(self.now_ns, moved, np.zeros(3))
            self.eyes.watch(self.now_ns)


@pytest.fixture(scope="module")
def images():
    station = Station()
    station.rig.close()
    return station


@pytest.fixture
def station(images):
    images.screen = dict(images.live)
    images.asked = EfferenceCopy()
    images.told.clear()
    images.looks = 0
    images.eyes = SeeingPerception(images._images, images.asked, 0.08, 0.12, images.told.append)
    return images


def test_without_images_there_is_no_percept(station):
    station.screen = dict.fromkeys(station.live)
    station.run(1.0)
    assert station.eyes.look(station.now_ns) is None


def test_he_glances_at_his_own_rate_and_understands_a_little_later(station):
    station.run(0.05)
    assert station.looks == 1
    assert station.eyes.look(station.now_ns) is None
    station.run(0.95)
    assert 11 <= station.looks <= 13
    assert station.eyes.look(station.now_ns) is not None


def test_images_that_hang_are_noticed_by_the_moving_hand_and_grow_old(station):
    station.run(1.0)
    before = station.eyes.look(station.now_ns)
    station.run(1.0, speed_m_s=0.1)
    percept = station.eyes.look(station.now_ns)
    assert set(station.told[-1].hanging) == {"eih", "gt", "gs"}
    assert station.now_ns - percept.t_ns > 400 * NS_PER_MS
    assert percept.gaps.block > 2.0 * before.gaps.block
    station.run(1.0)
    assert station.eyes.look(station.now_ns).t_ns == percept.t_ns


def test_a_still_hand_suspects_nothing(station):
    station.run(3.0)
    assert station.told[-1].hanging == ()
    assert station.now_ns - station.eyes.look(station.now_ns).t_ns < 400 * NS_PER_MS


def test_one_view_lost_costs_certainty_but_not_the_percept(station):
    station.run(1.0)
    whole = station.eyes.look(station.now_ns)
    station.screen["gs"] = station.screen["eih"] = None
    station.run(2.0)
    less = station.eyes.look(station.now_ns)
    assert less.gaps.block > whole.gaps.block
    assert set(station.told[-1].to_block) == {"gt"}
