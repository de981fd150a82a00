"""The eyes alone, on images of the rig."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from hw.sim.layout import VIEWS, draw_layout
from hw.sim.operator.task import Stage
from hw.sim.world.scene_renderer import CameraImages
from tams_app.config import DEFAULT_CONFIG, load_config
from tams_app.records import Image
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.sim.operator.seeing_rig import Eyes, SeeingRig

pytestmark = pytest.mark.untimed

CONFIG = load_config(DEFAULT_CONFIG).model_copy(update={"seed": 5})
_ABOVE_BLOCK = (Stage.REACH, Stage.TURN, Stage.DESCEND)


def _rig(cameras: CameraImages, **conditions) -> SeeingRig:
    return SeeingRig(CONFIG, 3, cameras, **conditions)


def _tick(rig: SeeingRig) -> bool:
    """One control period; whether the operator holds the trigger."""
    rig.tick()
    return rig.operator.hand.trigger > 0.5


def _reach(rig: SeeingRig, seconds: float) -> float:
    """Seconds until the operator is over the block; `seconds` when they do not get there."""
    start_ns = rig.now_ns
    while rig.operator.stage is Stage.REACH and rig.now_ns - start_ns < seconds * NS_PER_S:
        rig.tick()
    return (rig.now_ns - start_ns) / NS_PER_S


def _blurred(image: Image) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 4.0))


@pytest.fixture(scope="module")
def cameras():
    cameras = CameraImages(draw_layout(CONFIG.seed), CONFIG.seed)
    yield cameras
    cameras.close()


@dataclass(frozen=True)
class Reached:
    """How an operator got over the block; `live`: the first images."""

    seconds: float
    rig: SeeingRig
    live: dict[str, Image | None]


def _reached(cameras: CameraImages, seconds: float, **conditions) -> Reached:
    with closing(_rig(cameras, **conditions)) as rig:
        rig.tick()
        live = dict(rig.images())
        return Reached(_reach(rig, seconds), rig, live)


@pytest.fixture(scope="module")
def clear(cameras):
    return _reached(cameras, 15.0)


def test_on_clear_images_the_operator_gets_over_the_block_and_knows_where_it_is(clear):
    seconds, rig = clear.seconds, clear.rig
    assert seconds < 12.0
    seen = rig.glances[-1]
    assert np.linalg.norm((seen.believed_gap - seen.true_gap)[:2]) < 0.004
    assert seen.glance.block_sigma < 0.002


@pytest.mark.verify
def test_images_that_freeze_make_the_operator_let_go_and_wait(cameras):
    with closing(_rig(cameras)) as rig:
        start = rig.tcp
        while np.linalg.norm(rig.tcp - start) < 0.03:
            rig.tick()
            assert rig.now_ns < 12 * NS_PER_S, "the operator never reached"
        rig.frozen = True
        held = [_tick(rig) for _ in range(5 * 120)]  # twice what the rest of the way takes
        assert rig.operator.stage is Stage.REACH
        assert held.index(False) < 2 * 120
        assert sum(held) < 0.6 * len(held)
        rig.frozen = False
        assert _reach(rig, 20.0) < 20.0


def test_blurred_images_make_the_operator_less_certain(cameras, clear):
    # long enough to look, before the first motion
    blurred = _reached(cameras, 3.0, distort=_blurred)
    less, more = (
        float(np.median([seen.glance.block_sigma for seen in one.rig.glances[10:25]]))
        for one in (clear, blurred)
    )
    assert more > 1.5 * less


@pytest.mark.verify
def test_late_images_are_noticed_as_lag_and_cost_time(cameras, clear):
    late = _reached(cameras, 15.0, delay_ms=200.0)
    more_ns = late.rig.glances[-1].glance.lag_ns - clear.rig.glances[-1].glance.lag_ns
    assert more_ns == pytest.approx(200 * NS_PER_MS, abs=80 * NS_PER_MS)
    assert late.seconds > clear.seconds


def _present_errors_mm(rig: SeeingRig) -> np.ndarray:
    """How far off the gap over the table is, while they go down to the block."""
    while rig.operator.stage in _ABOVE_BLOCK and rig.now_ns < 20 * NS_PER_S:
        rig.tick()
    return np.array(
        [
            1000.0 * np.linalg.norm((seen.present_gap - seen.true_gap)[:2])
            for seen in rig.glances
            if seen.glance.stage == Stage.DESCEND
        ]
    )


@pytest.mark.verify
def test_a_wrist_view_that_is_titled_as_predicted_is_taken_for_the_present(cameras):
    """The others are late. Who does not read the title takes it for late, and is misled."""
    errors_mm = []
    for reads in (True, False):
        late = _rig(cameras, delay_ms=400.0, ahead=frozenset({"eih"}), titled=reads)
        with closing(late) as rig:
            errors_mm.append(_present_errors_mm(rig))
    read, misread = errors_mm
    assert len(read) > 40
    assert np.median(misread) > 1.5 * np.median(read)


def test_each_glance_tells_how_much_each_view_gave(clear):
    told = [seen.glance for seen in clear.rig.glances]
    assert all(abs(sum(one.to_block.values()) - 1.0) < 1e-9 for one in told if one.to_block)
    assert {view for one in told for view in one.to_block} == {"eih", "gt", "gs"}


@pytest.fixture
def eyes(clear):
    return Eyes(clear.live)


def test_without_images_there_is_no_percept(eyes):
    eyes.screen = dict.fromkeys(VIEWS)
    eyes.run(1.0)
    assert eyes.seeing.look(eyes.now_ns) is None


def test_operators_glance_at_their_own_rate_and_understand_a_little_later(eyes):
    eyes.run(0.05)
    assert eyes.looks == 1
    assert eyes.seeing.look(eyes.now_ns) is None
    eyes.run(0.95)
    assert 11 <= eyes.looks <= 13
    assert eyes.seeing.look(eyes.now_ns) is not None


def test_frozen_images_are_noticed_by_the_moving_hand_and_grow_old(eyes):
    eyes.run(1.0)
    before = eyes.seeing.look(eyes.now_ns)
    eyes.run(1.0, speed_m_s=0.1)
    percept = eyes.seeing.look(eyes.now_ns)
    assert set(eyes.told[-1].hanging) == {"eih", "gt", "gs"}
    assert eyes.now_ns - percept.t_ns > 400 * NS_PER_MS
    assert percept.gaps.block > 2.0 * before.gaps.block
    eyes.run(1.0)
    assert eyes.seeing.look(eyes.now_ns).t_ns == percept.t_ns


def test_a_still_hand_suspects_nothing(eyes):
    eyes.run(1.5)
    assert eyes.told[-1].hanging == ()
    assert eyes.now_ns - eyes.seeing.look(eyes.now_ns).t_ns < 400 * NS_PER_MS


def test_one_view_lost_costs_certainty_but_not_the_percept(eyes):
    eyes.run(1.0)
    whole = eyes.seeing.look(eyes.now_ns)
    eyes.screen["gs"] = eyes.screen["eih"] = None
    eyes.run(2.0)
    less = eyes.seeing.look(eyes.now_ns)
    assert less.gaps.block > whole.gaps.block
    assert set(eyes.told[-1].to_block) == {"gt"}
