"""The real window: what is on the screen against what was published, and real keys."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

from tams_app.faces.banner import LOOKS
from tams_app.faces.commands import Command
from tams_app.faces.messages import Ended, Keys, Pin
from tams_app.records import EpisodesState, EpisodeState, Image
from tests.faces.window.conftest import ShownWindow
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.photographs import (
    SAME,
    banner_is,
    difference,
    is_colour,
    place_of,
    width_of,
)
from tests.faces.window.xvfb import wait_for

# a window that does not paint for 150 ms takes no key
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]


def all_are_shown(window: ShownWindow, published: dict[str, Image]) -> bool:
    photograph = window.screen.photograph()
    return all(difference(photograph, view, image) < SAME for view, image in published.items())


@pytest.mark.parametrize("arming", ["ready", "engaged", "holding", "fault"])
def test_what_was_received_is_what_is_seen_and_banner_and_border_tell_the_state(
    window: ShownWindow, pictures: dict[str, Image], arming: str
) -> None:
    angle = list(LOOKS).index(arming)
    published = {view: np.rot90(image, 2 * angle).copy() for view, image in pictures.items()}
    window.put(published)
    window.show(changed(FACTS, arming=arming, reason="stale video", t_s=time.monotonic()))
    assert wait_for(lambda: all_are_shown(window, published))
    assert wait_for(lambda: banner_is(window.screen.photograph(), arming))


def test_a_frame_whose_drawing_is_put_off_is_not_seen_before_it_is_on_the_screen(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    """One of a small view just after one of the large view waits for the next of that."""
    window.show(changed(FACTS, primary_view="eih", t_s=time.monotonic()))
    assert wait_for(lambda: width_of(window.screen.photograph(), "eih") > 600)
    for number in range(8):
        grey = np.full_like(pictures["gt"], 10 + number * 30)
        drawings = window.client.keys.drawings if window.client.keys else 0
        window.put({"eih": pictures["eih"]})
        assert wait_for(lambda: window.client.keys.drawings > drawings, every_s=0.001)  # type: ignore[union-attr]  # noqa: B023
        put_ns = window.put({"gt": grey})
        assert wait_for(lambda: window.client.seen_ns.get("gt", 0) >= put_ns, every_s=0.001)  # noqa: B023
        assert difference(window.screen.photograph(), "gt", grey) < 3.0, number


def test_the_primary_view_gets_the_large_place_with_its_own_picture(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    window.put(pictures)
    for primary in ("gs", "eih"):
        time.sleep(1.0)  # views that have just exchanged stay for a moment
        facts = changed(FACTS, primary_view=primary, t_s=time.monotonic())
        window.show(facts)
        assert wait_for(lambda: width_of(window.screen.photograph(), primary) > 600)  # noqa: B023
        photograph = window.screen.photograph()
        assert all(
            width_of(photograph, view) < 400 for view in FACTS.state.views if view != primary
        )
        assert wait_for(lambda: all_are_shown(window, pictures))


def test_a_pinned_view_is_large_whatever_is_primary_until_its_key_comes_again(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    window.put(pictures)
    window.show(changed(FACTS, primary_view="eih", t_s=time.monotonic()))
    assert wait_for(lambda: width_of(window.screen.photograph(), "eih") > 600)
    window.key("2")
    assert wait_for(lambda: width_of(window.screen.photograph(), "gt") > 600)
    assert wait_for(lambda: all_are_shown(window, pictures))
    time.sleep(1.0)  # by when the primary view would have taken the large place
    assert width_of(window.screen.photograph(), "gt") > 600
    window.key("Tab")
    assert wait_for(lambda: width_of(window.screen.photograph(), "gt") < 400)
    window.key("Tab")
    assert wait_for(lambda: width_of(window.screen.photograph(), "gt") > 600)
    window.key("2")
    assert wait_for(lambda: width_of(window.screen.photograph(), "eih") > 600)
    pins = [event.view for event in window.events if isinstance(event, Pin)]
    assert pins in (["gt", small, "gt", ""] for small in ("eih", "gs"))


def test_that_the_block_is_placed_is_written_over_the_primary_view(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    window.put(pictures)

    def is_written() -> bool | None:
        photograph = window.screen.photograph()
        place = place_of(photograph, "eih")
        return None if place is None else bool(is_colour(photograph[place], "#1B8A3A").sum() > 5000)

    for is_there, facts in (
        (False, {"placed": False}),
        (True, {"placed": True}),
        (False, {"placed": True, "end": Ended("Over")}),  # nothing can go on
        (False, {"placed": False}),  # what shares this window finds it live
    ):
        window.show(changed(FACTS, arming="ready", t_s=time.monotonic(), **facts))
        assert wait_for(lambda: is_written() is is_there)  # noqa: B023


def test_enter_confirms_once_however_long_it_is_held(window: ShownWindow) -> None:
    window.events.clear()

    def held() -> list[tuple[str, ...]]:
        return [event.held for event in window.events if isinstance(event, Keys)]

    window.screen.xdotool("keydown", "Return")
    assert wait_for(lambda: ("Return",) in held())
    time.sleep(1.5)  # the server repeats it after 0.66 s
    since = held()[held().index(("Return",)) :]
    window.screen.xdotool("keyup", "Return")
    assert wait_for(lambda: window.client.keys is not None and window.client.keys.held == ())
    assert window.commands() == [Command.CONFIRM]
    assert set(since) == {("Return",)}  # while it repeats it stays held
    window.key("Return")
    assert wait_for(lambda: window.commands() == [Command.CONFIRM, Command.CONFIRM])


def test_space_escape_and_the_button_stop_and_q_ends(window: ShownWindow) -> None:
    window.events.clear()
    window.key("space")
    window.key("Escape")
    window.screen.xdotool("mousemove", "1210", "43", "click", "1")
    assert wait_for(lambda: len(window.commands()) == 3)
    window.key("space")  # the button has not taken the keys
    window.key("q")
    assert wait_for(lambda: len(window.commands()) == 5)
    assert window.commands() == [Command.EMERGENCY_STOP] * 4 + [Command.QUIT]


def test_keys_and_pedals_ask_about_episodes_once_for_each_press(window: ShownWindow) -> None:
    window.events.clear()
    window.screen.xdotool("keydown", "e")
    time.sleep(1.5)  # the server repeats it after 0.66 s
    window.screen.xdotool("keyup", "e", "key", "Next", "key", "z", "key", "Prior")
    window.key("u", "y", "n")
    assert wait_for(lambda: len(window.commands()) == 7)
    assert window.commands() == [
        *[Command.EPISODE] * 2,
        *[Command.DISCARD] * 2,
        Command.REDO,
        Command.SUCCESS,
        Command.FAILURE,
    ]


def test_episodes_have_a_row_only_in_a_session_that_has_them(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    window.put(pictures)
    window.show(FACTS)
    assert wait_for(lambda: all_are_shown(window, pictures))
    full = width_and_height(window)
    last = (EpisodeState(1, 9.0, False), EpisodeState(2, 12.0, True, True))
    episodes = EpisodesState(3, "recording", 4.2, "", 1, 1, last)
    window.show(changed(FACTS, episodes=episodes))
    assert wait_for(lambda: width_and_height(window)[1] < full[1] - 10)
    assert all_are_shown(window, pictures)
    window.show(FACTS)
    assert wait_for(lambda: width_and_height(window) == full)


def width_and_height(window: ShownWindow) -> tuple[int, int]:
    """Of the place of the large view [px]."""
    place = place_of(window.screen.photograph(), "eih")
    assert place is not None
    rows, columns = place
    return columns.stop - columns.start, rows.stop - rows.start


def test_a_key_that_goes_up_with_or_without_shift_is_up(window: ShownWindow) -> None:
    """Shift goes down or up in between: the name of what is held must not change with it."""

    def held() -> tuple[str, ...]:
        return () if window.client.keys is None else window.client.keys.held

    for down, up in (("w", "Shift_L"), ("Shift_L", "w")):
        window.screen.xdotool("keydown", down)
        other = {"w": "Shift_L", "Shift_L": "w"}[down]
        window.screen.xdotool("keydown", other)
        assert wait_for(lambda pair=(down, other): held() == pair)
        window.screen.xdotool("keyup", up)
        left = {"w": "Shift_L", "Shift_L": "w"}[up]
        assert wait_for(lambda name=left: held() == (name,))
        window.screen.xdotool("keyup", left)
        assert wait_for(lambda: held() == ())


def test_f1_lists_the_keys_and_hides_them_again(window: ShownWindow) -> None:
    before = window.screen.photograph()
    window.key("F1")

    def changed() -> float:
        return float((window.screen.photograph() != before)[200:500, 300:900].mean())

    assert wait_for(lambda: changed() > 0.3)
    window.key("F1")
    assert wait_for(lambda: changed() < 0.01)


def test_a_window_that_stands_still_delays_nobody_and_shows_the_newest_when_it_goes_on(
    window: ShownWindow, pictures: dict[str, Image]
) -> None:
    assert window.client.pid is not None
    os.kill(window.client.pid, signal.SIGSTOP)
    try:
        spent_ns = time.process_time_ns()
        for number in range(300):  # ten seconds of frames: the rings go round many times
            window.put(pictures)
            window.show(changed(FACTS, t_s=time.monotonic() + number))
        spent_ns = time.process_time_ns() - spent_ns
        blocked = window.client.ended
        newest = {view: np.flipud(image).copy() for view, image in pictures.items()}
        window.put(newest)
    finally:
        os.kill(window.client.pid, signal.SIGCONT)
    assert not blocked
    assert wait_for(lambda: all_are_shown(window, newest))
