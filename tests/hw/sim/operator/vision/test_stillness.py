import numpy as np
import pytest

from hw.sim.operator.vision.stillness import StillnessWatch
from tams_app.runtime.clock import NS_PER_MS

pytestmark = pytest.mark.untimed

LOOK_NS = 80 * NS_PER_MS


def _image(shift=0, seed=0):
    random = np.random.default_rng(seed)
    image = np.full((480, 640, 3), 80, np.uint8)
    image[200:300, 200 + shift : 300 + shift] = 200
    noise = random.normal(0.0, 1.5, image.shape[:2])[..., None]
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _look(watch, count, asked_m, shift_px=0, start=0):
    return [
        watch.hangs((start + look) * LOOK_NS, _image(shift_px * look, seed=look), asked_m)
        for look in range(count)
    ]


def test_a_image_that_moves_with_the_hand_does_not_hang():
    assert not any(_look(StillnessWatch(), 10, 0.005, shift_px=5))


def test_a_image_that_stands_while_the_hand_moves_hangs():
    hangs = _look(StillnessWatch(), 10, 0.005)
    assert not any(hangs[:3])
    assert all(hangs[4:])


def test_a_still_hand_says_nothing_about_the_image():
    assert not any(_look(StillnessWatch(), 30, 0.0))


def test_a_hanging_image_is_trusted_again_once_it_moves_or_after_a_while():
    watch = StillnessWatch()
    assert _look(watch, 6, 0.005)[-1]
    assert not watch.hangs(6 * LOOK_NS, _image(30, seed=9), 0.0)
    watch = StillnessWatch()
    _look(watch, 6, 0.005)
    later = _look(watch, 40, 0.0, start=6)
    assert later[0]
    assert not later[-1]
