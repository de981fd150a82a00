"""The 3D mouse's driver: what its reports mean, and what hidapi's errors become."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.desk.spacemouse import Reports, SpaceMouse
from hw.desk.virtual_hand import NEUTRAL
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Presses
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import Floats3
from tests.hw.desk.fake_mouse import LEFT, RIGHT, FakeMouse, axes_report, buttons_report

pytestmark = pytest.mark.untimed


@pytest.fixture
def reports() -> Reports:
    return Reports(dead_zone=0.0)


@pytest.mark.parametrize(
    ("report", "linear", "angular"),
    [
        (axes_report(1, 350, 0, 0), (0, -1, 0), (0, 0, 0)),  # to the right
        (axes_report(1, 0, -350, 0), (1, 0, 0), (0, 0, 0)),  # away from the person
        (axes_report(1, 0, 0, -350), (0, 0, 1), (0, 0, 0)),  # lifted
        (axes_report(1, 0, 0, -175), (0, 0, 0.5), (0, 0, 0)),
        (axes_report(2, 0, 0, -350), (0, 0, 0), (0, 0, 1)),
        (axes_report(1, 0, -350, 0, 0, 0, -350), (1, 0, 0), (0, 0, 1)),  # wireless: all six
    ],
)
def test_a_report_of_axes_is_what_the_cap_does(
    reports: Reports, report: bytes, linear: Floats3, angular: Floats3
) -> None:
    reports.take(report, 0)
    asked = reports.deflection()
    assert asked.linear == pytest.approx(linear)
    assert asked.angular == pytest.approx(angular)


def test_the_left_button_is_the_deadman(reports: Reports) -> None:
    reports.take(buttons_report(LEFT), 0)
    assert reports.deflection().trigger == 1.0
    reports.take(buttons_report(0), 0)
    assert reports.deflection().trigger == 0.0


def press_right(reports: Reports, at_ns: int, for_ms: int, left: int = LEFT) -> Presses:
    """How often the hand's buttons have gone down once the right one is up again."""
    reports.take(buttons_report(left | RIGHT), at_ns)
    reports.take(buttons_report(left), at_ns + for_ms * NS_PER_MS)
    return reports.deflection().presses


def test_brief_presses_of_the_right_button_close_and_open_in_turn(reports: Reports) -> None:
    done = [press_right(reports, press * NS_PER_S, 100) for press in range(3)]
    assert done == [Presses(a=1), Presses(a=1, b=1), Presses(a=2, b=1)]
    assert reports.deflection().trigger == 1.0


def test_a_brief_press_without_the_deadman_does_nothing_and_does_not_count(
    reports: Reports,
) -> None:
    assert press_right(reports, 0, 1000, left=0) == Presses(grip=1)
    assert press_right(reports, 2 * NS_PER_S, 100, left=0) == Presses(grip=1)
    assert press_right(reports, 4 * NS_PER_S, 100) == Presses(grip=1, a=1)


def test_a_long_press_of_the_right_button_changes_the_mode_once(reports: Reports) -> None:
    reports.take(buttons_report(RIGHT), 0)
    reports.take(buttons_report(RIGHT), 500 * NS_PER_MS)  # it is told again while it is held
    assert reports.deflection().presses == Presses()
    reports.take(buttons_report(0), 800 * NS_PER_MS)
    reports.take(buttons_report(0), 900 * NS_PER_MS)
    assert reports.deflection().presses == Presses(grip=1)


@given(st.lists(st.binary(max_size=16), max_size=20))
def test_whatever_is_reported_stays_within_the_axes(content: list[bytes]) -> None:
    reports = Reports(dead_zone=0.12)
    for number, report in enumerate(content):
        reports.take(report, number)
        asked = reports.deflection()
        assert all(abs(axis) <= 1.0 for axis in (*asked.linear, *asked.angular))


@pytest.fixture
def mouse() -> Iterator[FakeMouse]:
    fake = FakeMouse()
    with fake.in_place_of_hidapi():
        yield fake


def test_all_reports_that_wait_are_taken_at_once(mouse: FakeMouse) -> None:
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    driver.open()
    assert driver.read()[0] == NEUTRAL
    mouse.waiting = [axes_report(1, 0, -100, 0), buttons_report(LEFT), axes_report(1, 0, -350, 0)]
    asked, _ = driver.read()
    assert asked.linear == pytest.approx((1.0, 0.0, 0.0))
    assert asked.trigger == 1.0
    driver.close()
    assert not mouse.is_open


def test_a_mouse_that_is_opened_again_has_nothing_pressed(mouse: FakeMouse) -> None:
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    driver.open()
    mouse.waiting = [buttons_report(LEFT)]
    assert driver.read()[0].trigger == 1.0
    driver.close()
    driver.open()
    assert driver.read()[0] == NEUTRAL


def test_what_hidapi_refuses_is_one_sentence_each(mouse: FakeMouse) -> None:
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    mouse.refuses = True
    with pytest.raises(DeviceError, match="right to read it"):
        driver.open()
    mouse.refuses = False
    driver.open()
    mouse.gone = True
    with pytest.raises(DeviceError, match="unplugged"):
        driver.read()
    with pytest.raises(DeviceError, match="no 3D mouse"):
        driver.open()
    with pytest.raises(DeviceError, match="'Pro'"):
        SpaceMouse(DeskConfig(name="Pro"), lambda: 0).open()


def last_known_ns(driver: SpaceMouse) -> int:
    return driver.read()[1]


@pytest.mark.parametrize("wireless", [None, True, False])
@pytest.mark.parametrize("buttons", [0, LEFT])
def test_a_deflected_mouse_that_reports_no_more_is_known_no_longer_than_its_last_report(
    mouse: FakeMouse, wireless: bool | None, buttons: int
) -> None:
    now_ns = NS_PER_S
    driver = SpaceMouse(DeskConfig(wireless=wireless), lambda: now_ns)
    driver.open()
    mouse.waiting = [buttons_report(buttons)]
    for _ in range(100):
        now_ns += 16 * NS_PER_MS
        mouse.waiting += [axes_report(1, 0, -350, 0)]
        assert last_known_ns(driver) == now_ns
    heard_ns = now_ns
    for _ in range(100):
        now_ns += 16 * NS_PER_MS
        mouse.waiting += [bytes((23, 80))]  # its battery tells nothing of the cap
        assert last_known_ns(driver) == heard_ns
    mouse.waiting = [axes_report(1, 0, 0, 0)]
    assert last_known_ns(driver) == now_ns


@pytest.mark.parametrize(
    ("product", "wireless", "may_rest"),
    [
        (0xC635, None, True),
        (0xC635, True, False),
        (0xC652, None, False),  # the receiver of several models
        (0xC652, False, True),
        (0xC6FF, None, False),  # of a model that is not known
    ],
)
def test_a_cap_at_rest_with_the_deadman_held_is_stale_unless_the_mouse_is_on_a_cable(
    mouse: FakeMouse, product: int, wireless: bool | None, may_rest: bool
) -> None:
    mouse.product = product
    now_ns = NS_PER_S
    driver = SpaceMouse(DeskConfig(wireless=wireless), lambda: now_ns)
    driver.open()
    mouse.waiting = [buttons_report(LEFT)]
    assert last_known_ns(driver) == now_ns
    now_ns += NS_PER_S
    assert last_known_ns(driver) == (now_ns if may_rest else NS_PER_S)
    mouse.waiting = [buttons_report(0)]
    assert last_known_ns(driver) == now_ns
    now_ns += NS_PER_S
    assert last_known_ns(driver) == now_ns


def test_a_button_that_went_up_in_a_gap_is_down_until_a_button_or_nothing_is_reported(
    mouse: FakeMouse,
) -> None:
    """What docs/SAFETY.md says of a report that the radio loses: it cannot be noticed."""
    now_ns = NS_PER_S
    driver = SpaceMouse(DeskConfig(wireless=True), lambda: now_ns)
    driver.open()
    mouse.waiting = [buttons_report(LEFT)]
    for _ in range(100):  # the report that it went up would be among them
        now_ns += 16 * NS_PER_MS
        mouse.waiting += [axes_report(1, 0, -350, 0)]
        deflection, known_ns = driver.read()
        assert (deflection.trigger, known_ns) == (1.0, now_ns)
    heard_ns = now_ns
    now_ns += NS_PER_S
    assert last_known_ns(driver) == heard_ns
    mouse.waiting = [buttons_report(0)]
    assert driver.read()[0].trigger == 0.0
