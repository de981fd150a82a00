"""The 3D mouse's driver: what its reports mean, and what hidapi's errors become."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from hypothesis import example, given
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


def test_a_cap_that_is_pushed_beyond_full_deflection_is_fully_deflected(reports: Reports) -> None:
    reports.take(axes_report(1, 350, -350, 0, -350, 350, 0), 0)
    full = reports.deflection()
    reports.take(axes_report(1, 400, -700, 0, -32768, 32767, 0), 0)
    assert reports.deflection() == full


@given(st.binary(max_size=16).filter(lambda report: not report or report[0] not in (1, 2, 3)))
@example(b"")
@example(bytes((23, *[0xFF] * 12)))
@example(axes_report(2, 350, 350))  # cut short
@example(bytes((3,)))
def test_a_report_that_is_not_known_or_cut_short_changes_nothing(report: bytes) -> None:
    reports = Reports(dead_zone=0.12)
    reports.take(buttons_report(LEFT), 0)
    reports.take(axes_report(1, 0, -350, 0, 0, 0, -350), 0)
    before = reports.deflection()
    reports.take(report, NS_PER_S)
    assert reports.deflection() == before


@pytest.mark.parametrize("report", [b"", bytes((0, 1)), bytes((23, 80))])
def test_a_report_of_another_kind_is_no_sign_of_life(reports: Reports, report: bytes) -> None:
    reports.take(axes_report(1, 0, -350, 0), NS_PER_S)
    reports.take(report, 2 * NS_PER_S)
    assert reports.known_ns(2 * NS_PER_S) == NS_PER_S


def test_reports_are_those_of_a_mouse_on_a_cable_unless_it_is_said_that_it_comes_by_radio() -> None:
    for made, known_ns in ((Reports(0.0), NS_PER_S), (Reports(0.0, by_radio=True), 0)):
        made.take(buttons_report(LEFT), 0)
        assert made.known_ns(NS_PER_S) == known_ns


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


@pytest.mark.parametrize(
    ("for_ms", "presses"), [(599, Presses(a=1)), (600, Presses(grip=1)), (601, Presses(grip=1))]
)
def test_a_press_of_600_ms_is_a_long_one(reports: Reports, for_ms: int, presses: Presses) -> None:
    assert press_right(reports, NS_PER_S, for_ms) == presses


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


def test_a_mouse_that_was_never_opened_is_a_device_error_and_may_be_closed(
    mouse: FakeMouse,
) -> None:
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    with pytest.raises(DeviceError, match=r"^The 3D mouse is not open\.$"):
        driver.read()
    driver.close()
    assert mouse.openings == 0


CANNOT_BE_OPENED = (
    "The 3D mouse cannot be opened: give your user the right to read it "
    "(docs/OPERATOR.md has the udev rule), then plug it in again."
)


def test_what_hidapi_refuses_is_one_sentence_each(mouse: FakeMouse) -> None:
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    mouse.refuses = True
    with pytest.raises(DeviceError, match=f"^{re.escape(CANNOT_BE_OPENED)}$"):
        driver.open()
    mouse.refuses = False
    driver.open()
    mouse.gone = True
    with pytest.raises(DeviceError, match=r"^The 3D mouse was unplugged: plug it in again\.$"):
        driver.read()
    with pytest.raises(DeviceError, match=r"^There is no 3D mouse: plug one in, or choose another"):
        driver.open()
    with pytest.raises(DeviceError, match=r"^There is no 3D mouse whose name has 'Pro' in it: "):
        SpaceMouse(DeskConfig(name="Pro"), lambda: 0).open()


@pytest.mark.parametrize(
    ("vendor", "product", "is_one"),
    [
        (0x256F, 0xC635, True),
        (0x256F, 0x0001, True),  # 3Dconnexion makes nothing else
        (0x046D, 0xC626, True),  # Logitech: an older one, and what is none
        (0x046D, 0xC602, False),
        (0x046D, 0xC640, False),
        (0x1234, 0xC626, False),
    ],
)
def test_a_3d_mouse_is_known_by_its_vendor_and_product(
    mouse: FakeMouse, vendor: int, product: int, is_one: bool
) -> None:
    mouse.vendor, mouse.product = vendor, product
    driver = SpaceMouse(DeskConfig(), lambda: 0)
    if is_one:
        driver.open()
        assert mouse.is_open
    else:
        with pytest.raises(DeviceError, match="no 3D mouse"):
            driver.open()


@pytest.mark.parametrize(
    ("wanted", "name", "is_one"),
    [
        ("", "SpaceMouse Compact", True),
        ("compact", "SpaceMouse Compact", True),
        ("MOUSE C", "SpaceMouse Compact", True),
        ("pro", "SpaceMouse Compact", False),
        ("", None, True),  # it does not tell its name
        ("x", None, False),
        ("x", "", False),
    ],
)
def test_a_3d_mouse_is_found_by_a_part_of_its_name_in_small_or_capital_letters(
    mouse: FakeMouse, wanted: str, name: str | None, is_one: bool
) -> None:
    mouse.name = name
    driver = SpaceMouse(DeskConfig(name=wanted), lambda: 0)
    if is_one:
        driver.open()
        assert mouse.is_open
    else:
        with pytest.raises(DeviceError, match=f"{wanted!r}"):
            driver.open()


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
