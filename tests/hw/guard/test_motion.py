"""What the guard thinks of an arm's motion: no false stop, and none too late."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.arm_report import ArmReport
from hw.guard.link import motion_limits
from hw.guard.motion import CREPT_RAD, REST_M, Cause, Motion, MotionWatch
from tams_app.config import load_config
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

CONFIG = load_config()
LIMITS = motion_limits(CONFIG.arm, CONFIG.limits)
REPORT_MS, BEAT_MS = 10, 8
NOISE_M = 0.0002  # of a coordinate, standard deviation: the maker's repeatability is 0.5 mm
READY = (0.35, 0.0, 0.18)
JOINTS = (0.0, 0.642, 1.514, 0.0, 0.871, 0.0)
GRACE_MS = LIMITS.grace_ns / NS_PER_MS


def joints_at(x: float, y: float, z: float) -> tuple[float, ...]:
    """Joints that turn as far as those of an arm of some reach, wherever the TCP moves."""
    return (math.atan2(y, x), z / 0.4, x / 0.4, 0.0, 0.0, 0.0)


class Watched:
    """A motion watch that hears a beat each 8 ms, and an arm whose reports come when a test says.

    Time in milliseconds from the arming.
    """

    def __init__(self, motion: Motion = Motion.REST, speed: float = 0.0) -> None:
        self.watch = MotionWatch(LIMITS)
        self.watch.begin(0)
        self.motion, self.speed = motion, speed
        self._beat_ms = 0.0
        self.causes: list[tuple[float, Cause]] = []

    def beat_until(self, now_ms: float) -> None:
        while self._beat_ms <= now_ms:
            self.watch.hear(round(self._beat_ms * NS_PER_MS), self.motion, self.speed)
            self._beat_ms += BEAT_MS

    def see(
        self,
        now_ms: float,
        position: tuple[float, ...] = READY,
        joints: tuple[float, ...] | None = None,
        reading_ms: float = 0.05,
    ) -> Cause:
        """One report, read between `now_ms` and a little later; `joints` follow the TCP."""
        self.beat_until(now_ms)
        x, y, z = position
        before_ns = round(now_ms * NS_PER_MS)
        after_ns = before_ns + round(reading_ms * NS_PER_MS)
        cause = self.watch.look(
            before_ns, after_ns, ArmReport((x, y, z), joints or joints_at(x, y, z))
        )
        if cause:
            self.causes.append((now_ms, cause))
        return cause


def along(way_m: float) -> tuple[float, float, float]:
    """Along y, to and fro within 200 mm: inside the fence for ever."""
    phase = way_m % 0.4
    return (0.35, (phase if phase < 0.2 else 0.4 - phase) - 0.1, 0.18)


def steady(
    watched: Watched, begin_ms: float, end_ms: float, speed: float, way_m: float = 0.0
) -> Iterator[float]:
    """Reports of an arm at a constant speed [m/s]; the time of each, once it is judged."""
    for now_ms in np.arange(begin_ms, end_ms, REPORT_MS):
        watched.see(now_ms, along(way_m + speed * (now_ms - begin_ms) / 1000))
        yield float(now_ms)


# --- no false stop ------------------------------------------------------------------------------

delays_ms = st.one_of(
    st.floats(0, 3),  # an ordinary network and poll of 5 ms
    st.floats(0, 30),
    st.floats(0, 400),  # the guard, the arm or the network was held up
)


@given(
    st.lists(delays_ms, min_size=100, max_size=300),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.03, 0.1, 0.25]),
    st.floats(0.0, 0.015),
)
def test_an_arm_that_does_as_commanded_is_left_alone_however_its_reports_come(
    delays: list[float], seed: int, speed: float, lag_m: float
) -> None:
    """Held-up reports come in one burst, of which the newest counts; each has the sensors' noise.

    `lag_m`: the arm falls back by as much within the leash and catches up, twice a second.
    """
    noise = np.random.default_rng(seed)
    watched = Watched(Motion.FOLLOW, speed)
    held_until_ms = 0.0
    for number, delay_ms in enumerate(delays):
        sent_ms = number * float(REPORT_MS)
        held_until_ms = max(held_until_ms, sent_ms + delay_ms)
        next_ms = sent_ms + REPORT_MS
        if held_until_ms >= next_ms:
            continue  # a newer one has come by then
        way_m = speed * sent_ms / 1000 - lag_m * ((sent_ms // 500) % 2)
        place = np.array(along(way_m)) + noise.normal(0.0, NOISE_M, 3)
        turned = tuple(np.array(joints_at(*place)) + noise.normal(0.0, 1e-4, 6))
        watched.see(held_until_ms, tuple(place.tolist()), turned)
    assert watched.causes == []


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.0005, -0.001]))
def test_an_arm_that_stands_may_be_noisy_and_settle(seed: int, creep_m_s: float) -> None:
    noise = np.random.default_rng(seed)
    watched = Watched()
    for now_ms in range(0, 20_000, REPORT_MS):
        settled_m = creep_m_s * min(now_ms, 10_000) / 1000
        place = np.array(READY) + np.array((0.0, settled_m, 0.0))
        watched.see(float(now_ms), tuple((place + noise.normal(0.0, NOISE_M, 3)).tolist()))
    assert watched.causes == []


@given(st.floats(0.05, 0.25), st.floats(0, 150))
def test_braking_after_a_release_is_no_motion_unasked(speed: float, late_ms: float) -> None:
    """The stop profile takes 100 ms at most; the arm and its reports are behind by `late_ms`."""
    watched = Watched(Motion.FOLLOW, speed)
    *_, last_ms = steady(watched, 0, 1000, speed)
    watched.motion, watched.speed = Motion.REST, 0.0
    way_m = speed * last_ms / 1000
    for now_ms in range(1000, 3000, REPORT_MS):
        braking_ms = min(max(now_ms - 1000 - late_ms, 0.0), 100.0)
        before_ms = min(now_ms - last_ms, late_ms + 1000 - last_ms)
        braked_m = speed * (before_ms + braking_ms - braking_ms**2 / 200) / 1000
        watched.see(float(now_ms), along(way_m + braked_m))
    assert watched.causes == []


def test_a_motion_that_is_commanded_anew_after_a_rest_is_left_alone() -> None:
    watched = Watched()
    way_m = 0.0
    for second in range(0, 8, 2):
        watched.motion, watched.speed = Motion.FOLLOW, 0.25
        list(steady(watched, second * 1000, second * 1000 + 1000, 0.25, way_m))
        way_m += 0.25
        watched.motion, watched.speed = Motion.REST, 0.0
        list(steady(watched, second * 1000 + 1000, second * 1000 + 2000, 0.0, way_m))
    assert watched.causes == []


def test_the_way_home_is_judged_by_its_fastest_joint_and_by_the_floor_alone() -> None:
    watched = Watched(Motion.HOME, LIMITS.home_rad_s)
    for now_ms in range(0, 6000, REPORT_MS):
        turned = LIMITS.home_rad_s * now_ms / 1000
        joints = (turned, *JOINTS[1:])
        place = (0.7 * math.cos(turned), 0.7 * math.sin(turned), 0.5)  # far outside box and ring
        assert watched.see(float(now_ms), place, joints) is Cause.NONE
    assert watched.causes == []


# --- none too late ------------------------------------------------------------------------------


@given(st.floats(0.02, 0.5), st.integers(400, 5000))
def test_an_arm_that_moves_unasked_is_stopped_within_its_first_millimetres(
    speed: float, begin_ms: int
) -> None:
    watched = Watched()
    list(steady(watched, 0, begin_ms, 0.0))
    list(steady(watched, begin_ms, begin_ms + 1000, speed))
    now_ms, cause = watched.causes[0]
    assert cause is Cause.UNASKED
    moved_m = speed * (now_ms - begin_ms) / 1000
    assert moved_m <= REST_M * 1.12 + speed * REPORT_MS / 1000 + 0.0001


@pytest.mark.parametrize("rate_rad_s", [0.0002, 0.001, 0.0019])
def test_an_arm_that_creeps_is_stopped_however_slowly(rate_rad_s: float) -> None:
    """Not before it has crept so far: what settles is left alone."""
    watched = Watched()
    x, y, z = READY
    reach_m = math.hypot(x, y)
    every_ms, turned_rad = 100, 0.0
    for now_ms in range(0, 400_000, every_ms):
        turned_rad = rate_rad_s * now_ms / 1000
        place = (reach_m * math.cos(turned_rad), reach_m * math.sin(turned_rad), z)
        if watched.see(float(now_ms), place, (turned_rad, *JOINTS[1:])):
            break
    assert watched.causes[0][1] is Cause.UNASKED
    grace_rad = rate_rad_s * GRACE_MS / 1000
    assert CREPT_RAD <= turned_rad <= CREPT_RAD + grace_rad + 2 * rate_rad_s * every_ms / 1000


def test_a_joint_that_turns_about_the_tcp_moves_too() -> None:
    watched = Watched()
    list(steady(watched, 0, 500, 0.0))
    joints = (*joints_at(*along(0.0))[:5], 0.05)
    assert watched.see(510.0, along(0.0), joints) is Cause.UNASKED


@pytest.mark.parametrize(
    ("moved_m", "turned_rad", "cause"),
    [
        (0.0, 0.0199, Cause.NONE),
        (0.0, 0.0201, Cause.UNASKED),
        (0.0049, 0.01, Cause.NONE),
        (0.0051, 0.01, Cause.UNASKED),
        (0.0051, 0.0009, Cause.NONE),  # another tool
        (0.0051, 0.0011, Cause.UNASKED),
    ],
)
def test_at_rest_the_tcp_stays_within_5_mm_and_every_joint_within_20_mrad(
    moved_m: float, turned_rad: float, cause: Cause
) -> None:
    watched = Watched()
    x, y, z = READY
    watched.see(1000.0, READY, JOINTS)
    turned = (*JOINTS[:3], JOINTS[3] + turned_rad, *JOINTS[4:])
    assert watched.see(1010.0, (x, y, z + moved_m), turned) is cause


def test_the_place_of_rest_follows_no_further_than_the_arm() -> None:
    """It may follow by 1.8 mm in 0.9 s without a report, but the arm has crept half of that."""
    watched = Watched()
    x, y, z = READY
    watched.see(1000.0, (x, y, z))
    assert watched.see(1900.0, (x, y + 0.0009, z)) is Cause.NONE
    assert watched.see(1910.0, (x, y + 0.0009 + 1.06 * REST_M, z)) is Cause.UNASKED


@pytest.mark.parametrize("motion", [Motion.REST, Motion.HOME], ids=["rest", "home"])
def test_a_report_of_another_number_of_joints_is_an_error(motion: Motion) -> None:
    """The guard stops the arm when it fails: see `test_process`."""
    watched = Watched(motion, LIMITS.home_rad_s)
    watched.see(1000.0, READY, JOINTS)
    with pytest.raises(ValueError, match="zip"):
        watched.see(1010.0, READY, JOINTS[:5])


def test_a_tool_that_is_set_anew_is_no_motion_and_a_motion_after_it_is_one() -> None:
    watched = Watched()
    x, y, z = READY
    for now_ms in range(0, 1000, REPORT_MS):
        lower_m = 0.082 if now_ms > 600 else 0.0
        watched.see(float(now_ms), (x, y, z + lower_m), JOINTS)
    assert watched.causes == []
    moved = tuple(np.array(JOINTS) + 0.01)
    assert watched.see(1010.0, (x, y + 0.006, z + 0.082), moved) is Cause.UNASKED


@given(st.floats(0.02, 0.25))
def test_an_arm_that_goes_on_after_the_release_is_stopped_once_the_grace_is_over(
    speed: float,
) -> None:
    watched = Watched(Motion.FOLLOW, speed)
    list(steady(watched, 0, 1000, speed))
    watched.motion, watched.speed = Motion.REST, 0.0
    for now_ms in range(1000, 3000, REPORT_MS):
        x, y, z = along(speed)
        watched.see(float(now_ms), (x, y, z + speed * (now_ms - 1000) / 1000))
    when_ms, cause = watched.causes[0]
    assert cause is Cause.UNASKED
    latest_ms = GRACE_MS + 1000 * REST_M * 1.12 / speed + 3 * REPORT_MS
    assert GRACE_MS - BEAT_MS < when_ms - 1000 < latest_ms


@pytest.mark.parametrize(
    ("commanded", "speed", "within_ms"),
    [(0.25, 0.5, 180), (0.25, 0.4, 330), (0.05, 0.25, 170), (0.0, 0.1, 300), (10.0, 0.5, 180)],
)
def test_an_arm_that_is_too_fast_is_stopped(
    commanded: float, speed: float, within_ms: float
) -> None:
    """The last one: what the control loop declares counts up to the configured limit only."""
    watched = Watched(Motion.FOLLOW, commanded)
    begin_m = min(commanded, 0.25)
    list(steady(watched, 0, 1000, begin_m))
    assert watched.causes == []
    list(steady(watched, 1000, 3000, speed, begin_m))
    when_ms, cause = watched.causes[0]
    assert cause is Cause.TOO_FAST
    assert when_ms - 1000 <= within_ms


def test_a_joint_that_is_too_fast_on_the_way_home_is_stopped() -> None:
    watched = Watched(Motion.HOME, LIMITS.home_rad_s)
    for now_ms in range(0, 1000, REPORT_MS):
        joints = (2.5 * LIMITS.home_rad_s * now_ms / 1000, *JOINTS[1:])
        if watched.see(float(now_ms), READY, joints):
            break
    assert watched.causes[0][1] is Cause.TOO_FAST
    assert now_ms <= 400


GAPS_MS = {  # before the report that is judged, and the longest of them that counts
    "steady": ([10] * 50, 10),
    "one longer gap": ([10] * 50 + [200] + [10] * 50, 200),
    "a shorter one after it": ([200, 10, 10, 100, 10, 10], 200),
    "just before the report": ([10] * 50 + [200], 200),
    "almost a second ago": ([200] + [10] * 95, 200),
    "more than a second ago": ([200] + [10] * 105, 10),
    "as long again later": ([200] + [10] * 70 + [200] + [10] * 50, 200),
    "too long to count whole": ([10] * 50 + [600], 300),
}


def ahead_of_commanded(motion: Motion, gaps_ms: list[int], ahead: float) -> Cause:
    """What becomes of an arm that is `ahead` of what it may do in the last of its reports [m; rad].

    Until then it goes as fast as is ever tolerated: 1.1 times what is commanded, and the margin.
    """
    watched = Watched(motion, 0.8 * LIMITS.home_rad_s)
    if motion is Motion.FOLLOW:
        watched.speed = 0.2
    tolerated = 1.1 * watched.speed + (0.025 if motion is Motion.FOLLOW else 0.02)

    def see(now_ms: int, way: float) -> Cause:
        if motion is Motion.HOME:
            return watched.see(now_ms, READY, (way, *JOINTS[1:]))
        return watched.see(now_ms, (0.2, way - 0.3, 0.18))

    now_ms = 0
    for gap_ms in gaps_ms:
        assert see(now_ms, tolerated * now_ms / 1000) is Cause.NONE
        now_ms += gap_ms
    return see(now_ms, tolerated * now_ms / 1000 + ahead)


@pytest.mark.parametrize("gaps", GAPS_MS)
@pytest.mark.parametrize("motion", [Motion.FOLLOW, Motion.HOME], ids=["follow", "home"])
def test_an_arm_may_be_ahead_by_leash_noise_and_the_way_of_late_reports_and_no_further(
    motion: Motion, gaps: str
) -> None:
    gaps_ms, counts_ms = GAPS_MS[gaps]
    late_s = 0.030 + counts_ms / 1000
    if motion is Motion.FOLLOW:
        most = LIMITS.leash_m + 0.0025 + (1.1 * 0.2 + 0.025) * late_s
    else:
        most = 0.05 + (1.1 * 0.8 * LIMITS.home_rad_s + 0.02) * late_s
    assert ahead_of_commanded(motion, gaps_ms, most - 0.0003) is Cause.NONE
    assert ahead_of_commanded(motion, gaps_ms, most + 0.0003) is Cause.TOO_FAST


def test_the_fastest_command_of_the_last_300_ms_counts() -> None:
    watched = Watched(Motion.FOLLOW, 0.25)
    list(steady(watched, 0, 1000, 0.25))
    watched.speed = 0.02
    list(steady(watched, 1000, 1290, 0.25, 0.25))
    assert watched.causes == []
    list(steady(watched, 1290, 1500, 0.25, 0.25 + 0.29 * 0.25))
    now_ms, cause = watched.causes[0]
    assert cause is Cause.TOO_FAST
    assert now_ms <= 1420


def test_just_armed_an_arm_may_come_to_rest_but_nothing_is_commanded() -> None:
    """It still moves at 250 mm/s: more than what comes to rest does within the first 100 ms."""
    watched = Watched()
    list(steady(watched, 0, GRACE_MS, 0.25))
    now_ms, cause = watched.causes[0]
    assert cause is Cause.TOO_FAST
    assert now_ms <= 100


BOUNDS = {
    "left": ((0.25, -0.32, 0.18), (0.0, -1.0, 0.0)),
    "right": ((0.35, 0.2, 0.18), (0.0, 1.0, 0.0)),
    "near": ((0.2, 0.0, 0.18), (-1.0, 0.0, 0.0)),
    "far": ((0.4, 0.0, 0.18), (1.0, 0.0, 0.0)),
    "above": ((0.35, 0.0, 0.39), (0.0, 0.0, 1.0)),
    "floor": ((0.35, 0.0, 0.01), (0.0, 0.0, -1.0)),
    "ring": ((0.3, 0.28, 0.18), (0.5, math.sqrt(0.75), 0.0)),
}


@pytest.mark.parametrize("bound", BOUNDS)
def test_an_arm_that_leaves_its_fence_is_stopped_beyond_the_margin(bound: str) -> None:
    start, direction = BOUNDS[bound]
    watched = Watched(Motion.FOLLOW, 0.1)
    for now_ms in range(0, 3000, REPORT_MS):
        way_m = 0.1 * now_ms / 1000
        place = tuple(here + way_m * along for here, along in zip(start, direction, strict=True))
        if watched.see(float(now_ms), place):
            break
    assert watched.causes[0][1] is Cause.OUTSIDE
    beyond_m = max(LIMITS.excess(place, Motion.FOLLOW))
    assert LIMITS.margin_m < beyond_m < LIMITS.margin_m + 0.004


def test_each_bound_of_the_fence_is_measured_from_the_place_of_the_tcp() -> None:
    *_, floor, inside, outside = LIMITS.excess((0.3, 0.4, 0.1), Motion.FOLLOW)
    assert floor == pytest.approx(LIMITS.floor - 0.1)
    assert (inside, outside) == pytest.approx((LIMITS.radius_min - 0.5, 0.5 - LIMITS.radius_max))
    assert LIMITS.excess((0.3, 0.4, 0.1), Motion.HOME) == pytest.approx((LIMITS.floor - 0.1,))


def test_the_second_report_in_a_row_beyond_the_fence_and_no_single_one_stops_the_arm() -> None:
    watched = Watched(Motion.FOLLOW, 10.0)
    edge_m = LIMITS.high[1]
    inside, outside = (0.2, edge_m - 0.001, 0.18), (0.2, edge_m + LIMITS.margin_m + 0.001, 0.18)
    for now_ms, place in enumerate((inside, outside, inside, outside)):
        assert watched.see(REPORT_MS * now_ms, place) is Cause.NONE
    assert watched.see(40, outside) is Cause.OUTSIDE


def test_a_fence_of_which_an_edge_is_missing_is_an_error_and_no_open_side() -> None:
    for broken in (LIMITS._replace(low=LIMITS.low[:2]), LIMITS._replace(high=LIMITS.high[:2])):
        with pytest.raises(ValueError, match="zip"):
            broken.excess(READY, Motion.FOLLOW)


def test_from_outside_inward_is_free_and_back_out_is_not() -> None:
    watched = Watched(Motion.FOLLOW, 0.2)
    stations_m = (0.40, 0.36, 0.38, 0.30, 0.345, 0.36)  # of y: fence .33, margin .02
    now_ms, found = 0.0, []
    for here, there in pairwise(stations_m):
        for share in np.arange(0.0, 1.0, 0.02):
            cause = watched.see(now_ms, (0.2, here + share * (there - here), 0.18))
            if cause and not found:
                found.append((cause, here, there))
            now_ms += REPORT_MS
    assert found == [(Cause.OUTSIDE, 0.345, 0.36)]


def test_after_a_silence_of_less_than_a_second_the_arm_is_where_it_was() -> None:
    watched = Watched()
    list(steady(watched, 0, 1000, 0.0))
    assert watched.see(1980.0, (0.35, 0.1, 0.2)) is Cause.UNASKED


def test_after_a_silence_of_a_second_nothing_from_before_is_compared() -> None:
    watched = Watched()
    *_, last_ms = steady(watched, 0, 1000, 0.0)
    assert watched.see(last_ms + 1001.0, (0.35, 0.1, 0.2)) is Cause.NONE
    assert watched.see(last_ms + 1011.0, (0.35, 0.1, 0.2)) is Cause.NONE
    assert watched.see(last_ms + 1021.0, (0.35, 0.11, 0.2)) is Cause.UNASKED


def test_a_new_arming_begins_anew() -> None:
    watched = Watched()
    list(steady(watched, 0, 1000, 0.0))
    watched.watch.begin(1000 * NS_PER_MS)
    assert watched.see(1010.0, (0.35, 0.1, 0.2)) is Cause.NONE
    assert round(GRACE_MS) == 300
    assert LIMITS.grace_ns < NS_PER_S
