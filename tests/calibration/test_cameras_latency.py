"""The time pattern survives what cameras and screens do to it, and tells the latency."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration.cameras.latency import ScreenTimes, camera_latency, chained, latency
from calibration.cameras.plane import Placed, exposed, lens_of
from calibration.cameras.stream_delay import stream_delays_ms
from calibration.cameras.time_pattern import (
    COUNTS,
    PatternReader,
    TimePattern,
    from_gray_code,
    gray_code,
)
from tams_app.config import load_config
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S, MonotonicClock

pytestmark = pytest.mark.untimed

PATTERN, READER, LENS = TimePattern(12), PatternReader(), lens_of(600.0, 640, 480)
WIDTH_M = 0.5
PERIOD_NS = NS_PER_S // 60
REFRESH_MS = PERIOD_NS / NS_PER_MS


def filmed(flat, turn_deg=(0.0, 0.0, 0.0), distance_m=0.8, blur_px=0.7, noise=3.0, seed=0):
    """`flat` on a screen, seen askew, out of focus, with noise and a pale image."""
    width, height = PATTERN.size
    turn = Rotation.from_euler("xyz", turn_deg, degrees=True)
    place = Placed(np.array([0.02, -0.01, distance_m]), turn, WIDTH_M, WIDTH_M * height / width)
    random = np.random.default_rng(seed)
    behind = random.integers(50, 120, (480, 640, 3)).astype(np.uint8)
    seen = LENS.window_on(place, width / WIDTH_M, (height, width)).see(flat, behind)
    seen = cv2.GaussianBlur(seen, (0, 0), blur_px)
    return np.clip(0.7 * seen + 25 + random.normal(0, noise, seen.shape), 0, 255).astype(np.uint8)


@given(st.integers(0, COUNTS - 2))
def test_neighbouring_numbers_differ_in_one_bit_and_decode(count):
    assert from_gray_code(gray_code(count)) == count
    assert (gray_code(count) ^ gray_code(count + 1)).bit_count() == 1


@settings(max_examples=40)
@given(
    count=st.integers(0, COUNTS - 2),
    share=st.floats(0, 1),
    tilt=st.tuples(*[st.floats(-25, 25)] * 3),
    distance_m=st.floats(0.6, 1.2),
    blur_px=st.floats(0.3, 1.6),
    noise=st.floats(0, 6),
)
def test_an_exposure_over_two_refreshes_reads_as_one_of_them_and_the_nearer(
    count, share, tilt, distance_m, blur_px, noise
):
    both = exposed([PATTERN.draw(count), PATTERN.draw(count + 1)], [1 - share, share])
    reading = READER.read(filmed(both, tilt, distance_m, blur_px, noise))
    assert reading.reason == ""
    assert reading.count in (count, count + 1)
    if abs(share - 0.5) > 0.15:
        assert reading.count == count + (share > 0.5)


@settings(max_examples=30)
@given(count=st.integers(0, COUNTS - 2), line=st.floats(0, 1), blur_px=st.floats(0.3, 1.5))
def test_a_screen_torn_between_two_refreshes_never_reads_as_a_third(count, line, blur_px):
    torn = PATTERN.draw(count)
    row = round(line * len(torn))
    torn[:row] = PATTERN.draw(count + 1)[:row]
    assert READER.read(filmed(torn, blur_px=blur_px)).count in (count, count + 1, -1)


def test_images_that_cannot_be_read_say_why():
    nothing = np.full((480, 640, 3), 90, np.uint8)
    assert "0 of its 4 corners are seen" in READER.read(nothing).reason
    hidden = filmed(PATTERN.draw(1234))
    hidden[150:330, 180:460] = 128
    assert READER.read(hidden).count == -1
    grey = exposed([PATTERN.draw(0), PATTERN.draw(from_gray_code(0b0011_1111))], [0.5, 0.5])
    reading = READER.read(filmed(grey))
    assert reading.count == -1
    assert "squares are in between" in reading.reason


@pytest.mark.parametrize(
    ("true_ms", "exposure_ms"), [(0.0, 2.0), (41.0, 2.0), (12.5, 10.0), (0.0, 25.0), (41.0, 25.0)]
)
def test_a_known_latency_is_recovered_within_half_a_refresh(true_ms, exposure_ms):
    random = np.random.default_rng(7)
    screen = ScreenTimes(5 * NS_PER_S, PERIOD_NS, "synthetic")
    captures, counts = [], []
    start_ns = screen.start_ns + round(random.uniform(0, 1) * NS_PER_S)
    for number in range(25):
        begin_ns = start_ns + number * NS_PER_S // 30
        end_ns = begin_ns + round(exposure_ms * NS_PER_MS)
        first, last = (round((t - screen.start_ns) // PERIOD_NS) for t in (begin_ns, end_ns - 1))
        edges = [screen.start_ns + count * PERIOD_NS for count in range(first, last + 2)]
        lit = [min(end_ns, b) - max(begin_ns, a) for a, b in pairwise(edges)]
        shares = [part / (end_ns - begin_ns) for part in lit]
        flat = exposed([PATTERN.draw(count) for count in range(first, last + 1)], shares)
        reading = READER.read(filmed(flat, (10, -15, 5), seed=number))
        if reading.count >= 0:
            counts.append(reading.count)
            captures.append((begin_ns + end_ns) // 2 + round(true_ms * NS_PER_MS))
    found = camera_latency(captures, counts, screen)
    assert abs(found.median_ms - true_ms) <= REFRESH_MS / 2 + 0.01
    assert found.error_ms == pytest.approx(REFRESH_MS / 12**0.5)


def test_outliers_are_counted_and_too_few_readings_refused():
    found = latency([20.0] * 30 + [900.0] * 3, REFRESH_MS)
    assert (found.median_ms, found.rejected) == (20.0, 3)
    with pytest.raises(ValueError, match="needs 20 readings that agree, got 5"):
        latency([20.0] * 5, REFRESH_MS)


def test_the_sum_of_two_stretches_has_both_errors():
    both = chained(latency([20.0, 22.0] * 20, 12.0), latency([50.0, 54.0] * 20, 0.0))
    assert both.median_ms == pytest.approx(73.0, abs=1.0)
    assert both.error_ms == pytest.approx(12.0 / 12**0.5)


def test_the_stream_from_capture_to_shown_is_measured_on_the_products_own_chain():
    clock, config = MonotonicClock(), load_config()
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
    waited_ns = 40 * NS_PER_MS  # what the camera took before

    def images():
        for number in range(45):
            clock.sleep_until_ns(clock.now_ns() + NS_PER_S // 30)
            yield np.roll(image, number, axis=1), clock.now_ns() - waited_ns

    delays = stream_delays_ms("gt", config, images(), clock)
    assert len(delays) >= 10
    assert min(delays) > 40.0
