"""The live line: what it says, and how it behaves on a terminal and in a file."""

from __future__ import annotations

import io
from typing import Any

import pytest
from msgspec.structs import replace

from tams_app.faces.terminal.line import COLUMNS, PLAIN_EVERY_S, StatusLine, status_words
from tams_app.printing import Console
from tams_app.records import EpisodesState, EpisodeState, LatencyState, ViewState
from tests.faces.window import facts

pytestmark = pytest.mark.untimed

STATE = replace(
    facts.STATE,
    t_s=72.34,
    pressed=(),
    phase="ALIGN",
    primary_view="",
    tcp_mm=(350.2, -1.4, 180.0),
    gripper_closed=None,
    views={"eih": ViewState(3000, 2950.4, 14.9, age_ms=81.6), "gt": ViewState()},
    capacity_kbps=6000.0,
    estimate_kbps=5900.0,
    queue_ms=12.2,
)


ARM = "1:12.3 ENGAGED ALIGN held"


def test_the_line_says_all_an_operator_looks_for() -> None:
    text = status_words(STATE).plain
    for part in (
        "1:12.3",
        "ENGAGED",
        "ALIGN",
        "trigger held, translation, TCP x 350 y -1 z 180 mm",
        "eih 2950/3000 kbit/s 15/30 fps 82 ms",
        "gt –/– kbit/s –/30 fps – ms",
        "link 5210/5520 kbit/s, capacity 6000, estimated 5900, queue 12 ms",
    ):
        assert part in text
    assert "last stop" not in text


@pytest.mark.parametrize(
    ("changes", "live"),
    [
        ({"primary_view": "gt"}, f"{ARM} gt –/–k –ms –/30fps link 5210/5520k q12ms"),
        ({}, f"{ARM} eih 2950/3000k 82ms 15/30fps link 5210/5520k q12ms"),
        ({"views": {}}, f"{ARM} link 5210/5520k q12ms"),
        (
            {
                "t_s": 7272.3,
                "arming": "link lost",
                "phase": "PRE_RELEASE",
                "budget_kbps": 100_000.0,
            },
            "121:12.3 LINK LOST PRE_RELEASE held eih 2950/3000k 82ms 15/30fps",
        ),
    ],
)
def test_the_live_line_has_the_primary_view_and_fits_80_columns(
    changes: dict[str, Any], live: str
) -> None:
    assert status_words(replace(STATE, **changes)).live == live
    assert len(live) <= COLUMNS


def test_what_makes_the_primary_view_late_is_named() -> None:
    own = LatencyState(40, "encoder", 22)
    late = replace(STATE, primary_view="gt", views={"gt": ViewState(shown_fps=30.0, own=own)})
    told = "GT 40 ms besides the network (encoder 22): use fewer frames"
    assert told in status_words(late).plain
    assert status_words(late).why == told
    assert "besides" not in status_words(STATE).plain


def test_the_primary_view_s_quality_is_shown_once_it_was_measured() -> None:
    eih = replace(STATE.views["eih"], live_ssim=0.874)
    measured = replace(STATE, primary_view="eih", views={**STATE.views, "eih": eih})
    assert status_words(measured).plain.endswith("queue 12 ms, live SSIM of eih 0.87")
    eih = replace(eih, task_live_ssim=0.702)
    measured = replace(measured, views={**STATE.views, "eih": eih})
    assert status_words(measured).plain.endswith("live SSIM of eih 0.87, 0.70 at the task")
    assert "SSIM" not in status_words(STATE).plain


def test_the_line_shows_pressed_buttons_and_the_gripper_once_it_is_known() -> None:
    pressed = replace(STATE, pressed=("grip", "A"), gripper_closed=True)
    first, *_ = status_words(pressed).plain.split("  |  ")
    assert "trigger held, grip, A, translation, TCP" in first
    assert first.endswith("mm, gripper closed, motors not known")
    assert "mm, gripper open" in status_words(replace(STATE, gripper_closed=False)).plain
    assert "mm, gripper not known" in status_words(STATE).plain
    assert "motors to 41 °C" in status_words(replace(STATE, hottest_motor_c=41)).plain


def test_the_reason_of_the_last_hold_is_shown_as_it_is() -> None:
    reason = "[stale video] let go of the trigger"
    output = io.StringIO()
    with StatusLine(Console(file=output, width=80)) as line:
        line.update(replace(STATE, reason=reason, arming="holding", deadman=False))
    assert f"{reason}." in output.getvalue()
    assert "HOLDING" in output.getvalue()
    assert "trigger up" in output.getvalue()


@pytest.mark.parametrize("is_terminal", [True, False])
def test_what_is_left_to_do_is_told_in_the_words_of_the_hand(is_terminal: bool) -> None:
    held = replace(STATE, arming="holding", reason="stale video", hand="keyboard")
    for lasting, told in (
        ("stale video", "wait until it is back, then release Shift."),
        ("", "stale video. The video is back: release Shift."),
    ):
        output = io.StringIO()
        with StatusLine(Console(file=output, width=200, force_terminal=is_terminal)) as line:
            line.update(replace(held, lasting=lasting))
        assert told in output.getvalue()
        assert ("Shift held" in output.getvalue()) is not is_terminal


def test_the_last_stop_is_the_one_that_was_recorded() -> None:
    waiting = replace(STATE, arming="ready", last_stop="stale video")
    assert status_words(waiting).plain.endswith("last stop: stale video")
    in_the_way = status_words(replace(waiting, reason="pose frozen", lasting="pose frozen"))
    assert "last stop" not in in_the_way.plain
    assert "The hand's pose does not change" in in_the_way.plain


def test_without_a_terminal_there_is_one_plain_line_every_few_seconds() -> None:
    output = io.StringIO()
    with StatusLine(Console(file=output, width=80)) as line:
        for tenth in range(121):
            assert line.is_due(tenth / 10) == (tenth % round(10 * PLAIN_EVERY_S) == 0)
            line.update(replace(STATE, t_s=tenth / 10))
        line.notify("the arm is ready: press Enter", 12.1)
    lines = output.getvalue().splitlines()
    assert [one.split()[0] for one in lines[:3]] == ["0:00.0", "0:05.0", "0:10.0"]
    assert lines[3:] == ["0:12.1  the arm is ready: press Enter"]
    assert "\x1b" not in output.getvalue()


def test_on_a_terminal_the_line_is_renewed_at_five_hertz_and_taken_away() -> None:
    output = io.StringIO()
    console = Console(file=output, width=100, force_terminal=True, color_system="standard")
    with StatusLine(console) as line:
        for step in range(100):
            line.update(replace(STATE, t_s=step / 100))
        shown = output.getvalue().count("ENGAGED")
    assert 5 <= shown <= 6
    assert output.getvalue().endswith("\x1b[2K") or "\x1b[?25h" in output.getvalue()


def test_a_narrow_terminal_cuts_lines_instead_of_wrapping_them() -> None:
    output = io.StringIO()
    with StatusLine(Console(file=output, width=30, force_terminal=True)) as line:
        line.update(STATE)
    assert "…" in output.getvalue()


def test_the_episodes_are_in_the_line_and_in_full_below_it() -> None:
    last = (EpisodeState(1, 9.0, False), EpisodeState(2, 12.0, True, True))
    episodes = EpisodesState(3, "recording", 4.2, "discard", 1, 1, last)
    words = status_words(replace(STATE, episodes=episodes))
    told = (
        "episode 3: RECORDING 4 s · DISCARD? once more within 5 s · 1 kept, 1 discarded · "
        "last: 2 kept, success"
    )
    assert "episode 3: RECORDING 4 s" in words.live
    assert words.why == told
    assert told in words.plain
    assert "episode" not in status_words(STATE).plain
