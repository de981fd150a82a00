import numpy as np
import pytest

from hw.sim.operator.efference import (
    FOLLOW_LAG_NS,
    EfferenceCopy,
    FollowCheck,
    FrozenViewWatch,
    LagEstimator,
)
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

STEP_NS = 10 * NS_PER_MS
ZERO = np.zeros(3)


def test_motion_shows_only_in_views_taken_after_it_and_the_lag():
    asked = EfferenceCopy()
    for step in range(1, 11):
        asked.add(step * STEP_NS, np.array([0.001, 0, 0]), ZERO)
    assert asked.total[0] == pytest.approx(0.010)
    assert asked.shown_at(FOLLOW_LAG_NS)[0] == 0.0
    assert asked.shown_at(FOLLOW_LAG_NS + 4 * STEP_NS)[0] == pytest.approx(0.004)
    asked.idle(20 * STEP_NS)
    assert asked.shown_at(FOLLOW_LAG_NS + 30 * STEP_NS)[0] == pytest.approx(0.010)


def _verdicts(part: float, speed: float = 0.1, turning: bool = False) -> list[bool]:
    """What the check says in 3 s of steady motion of which `part` shows."""
    check, verdicts = FollowCheck(), []
    for step in range(300):
        size = speed * step * 0.01
        shown = np.zeros(6)
        shown[5 if turning else 0] = size
        tool = Pose(
            ZERO if turning else np.array([part * size, 0, 0]),
            Rotation.from_rotvec([0, 0, part * size if turning else 0.0]),
        )
        verdict = check.step(step * STEP_NS, shown, tool)
        if verdict is not None:
            verdicts.append(verdict)
    return verdicts


@pytest.mark.parametrize("turning", [False, True])
def test_a_tool_that_follows_is_trusted_and_one_that_does_not_is_noticed(turning):
    speed = 0.4 if turning else 0.1
    assert all(_verdicts(0.8, speed, turning))
    assert len(_verdicts(0.8, speed, turning)) >= 2
    assert not any(_verdicts(0.05, speed, turning))
    assert len(_verdicts(0.05, speed, turning)) >= 2


def test_a_hand_at_rest_is_no_evidence():
    assert _verdicts(0.0, speed=0.0) == []


def test_what_was_asked_can_be_looked_up_for_any_time_of_the_last_seconds():
    asked = EfferenceCopy()
    for step in range(1, 1001):
        asked.add(step * STEP_NS, np.array([0.001, 0, 0]), ZERO)
    totals = asked.asked_at_each([900 * STEP_NS, 999 * STEP_NS + 1, 2000 * STEP_NS])
    assert [total[0] for total in totals] == pytest.approx([0.9, 0.999, 1.0])
    assert asked.asked_at(900 * STEP_NS)[0] == pytest.approx(0.9)
    assert asked.asked_at(0)[0] == pytest.approx(0.7, abs=0.002)


TICK_NS, LOOK_NS = 8 * NS_PER_MS, 80 * NS_PER_MS
SLOPE = np.array([[1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0]])


def _run(lag_ms, seconds=6.0, noise_px=0.3, scale=1.0, moves=True, start_lag_ms=None):
    """A hand that goes to and fro; the image follows `lag_ms` late."""
    asked, estimator, random = EfferenceCopy(), LagEstimator(), np.random.default_rng(0)

    def where(t_ns):
        t_s = max(0.0, t_ns / 1e9)
        return 0.05 * np.array([np.sin(2.0 * t_s), np.sin(1.3 * t_s), 0.0]) * moves

    t_ns, next_look = 0, 0
    while t_ns < seconds * 1e9:
        asked.add(t_ns, where(t_ns) - where(t_ns - TICK_NS), np.zeros(3))
        if t_ns >= next_look:
            next_look += LOOK_NS
            late = lag_ms if start_lag_ms is None or t_ns > seconds * 0.3e9 else start_lag_ms
            pixel = SLOPE @ (scale * where(t_ns - late * NS_PER_MS))
            estimator.see("gt", t_ns, pixel + random.normal(0.0, noise_px, 2), SLOPE, asked)
        t_ns += TICK_NS
    return estimator.lag_ns / NS_PER_MS


@pytest.mark.parametrize("lag_ms", [60, 150, 300, 500])
def test_the_lag_is_learnt_from_hand_and_image(lag_ms):
    assert _run(lag_ms) == pytest.approx(lag_ms, abs=30)


def test_a_hand_at_rest_teaches_nothing():
    assert _run(500, moves=False, noise_px=0.0) == pytest.approx(200, abs=15)


def test_a_misjudged_scale_and_a_noisy_image_do_not_spoil_it():
    assert _run(250, scale=0.9, noise_px=1.5) == pytest.approx(250, abs=60)


def test_a_lag_that_changes_is_learnt_anew():
    assert _run(400, seconds=14.0, start_lag_ms=100) == pytest.approx(400, abs=50)


# --- frozen images ------------------------------------------------------------------------------


def _image(shift=0, seed=0):
    random = np.random.default_rng(seed)
    image = np.full((480, 640, 3), 80, np.uint8)
    image[200:300, 200 + shift : 300 + shift] = 200
    noise = random.normal(0.0, 1.5, image.shape[:2])[..., None]
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _look(watch, count, asked_m, shift_px=0, start=0):
    return [
        watch.is_frozen((start + look) * LOOK_NS, _image(shift_px * look, seed=look), asked_m)
        for look in range(count)
    ]


def test_an_image_that_moves_with_the_hand_is_not_frozen():
    assert not any(_look(FrozenViewWatch(), 10, 0.005, shift_px=5))


def test_a_frozen_image_is_trusted_again_once_it_moves_or_after_a_while():
    watch = FrozenViewWatch()
    assert _look(watch, 6, 0.005)[-1]
    assert not watch.is_frozen(6 * LOOK_NS, _image(30, seed=9), 0.0)
    watch = FrozenViewWatch()
    _look(watch, 6, 0.005)
    later = _look(watch, 40, 0.0, start=6)
    assert later[0]
    assert not later[-1]
