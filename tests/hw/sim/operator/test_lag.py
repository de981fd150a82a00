import numpy as np
import pytest

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.lag import LagEstimator
from tams_app.runtime.clock import NS_PER_MS

pytestmark = pytest.mark.untimed

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
