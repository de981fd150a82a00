"""The window of the operator's side, with the robot's side as a process of its own."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from tams_app.console import app
from tams_app.printing import Console
from tams_app.records import ControllerStatus
from tests.faces.window.photographs import SAME, banner_is, difference
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for
from tests.faults.applications import until
from tests.faults.two_sides import HandSide, RobotSide

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]

LOOKED_AT_S = 15.0


def test_in_every_state_it_shows_what_was_received_and_the_robots_figures_and_its_key_stops_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        virtual_screen(tmp_path, monkeypatch) as screen,
        RobotSide(tmp_path / "robot") as robot,
    ):
        robot.waits()
        side = HandSide(tmp_path / "operator", robot.port, headless=False)

        def drive() -> None:
            try:
                _drive(side, screen)
            finally:
                side.outset.end("driven")

        with ThreadPoolExecutor(1) as pool:
            driven = pool.submit(drive)
            app.show_session(side.outset, side.opening(), Console(quiet=True))
            driven.result()
        assert side.outset.failure == ""


def _drive(side: HandSide, screen: Screen) -> None:
    until(lambda: side.state is not None, "the robot's state")
    session = side.session
    screen.focus("TAMS")

    def shows_all(state: str) -> bool:
        photograph = screen.photograph()
        images = {view: side.received(view) for view in session.config.video.views}
        return banner_is(photograph, state) and all(
            image is not None and difference(photograph, view, image) < SAME
            for view, image in images.items()
        )

    def holds() -> None:
        side.engages()
        side.hand.distortion = lambda sample, _: replace(
            sample, status=ControllerStatus.TRACKING_LOST
        )

    def stops_by_its_key() -> None:
        side.engages()
        screen.xdotool("key", "space")

    ways = {
        "ready": side.arms,
        "engaged": side.engages,
        "holding": holds,
        "fault": stops_by_its_key,
    }

    for state, way in ways.items():
        side.hand.distortion = None
        way()
        assert wait_for(lambda: shows_all(state), LOOKED_AT_S), state  # noqa: B023

    def has_the_robots_figures() -> bool:
        now = session.state()
        rates = now.link_kbps, *(view.sent_kbps for view in now.views.values())
        others = now.budget_kbps, now.queue_ms, now.loss
        ages = [view.age_ms for view in now.views.values()]
        return all(rates) and all(ages) and None not in others

    until(has_the_robots_figures, "what only the robot's side knows")
    side.hand.a = True
    until(lambda: session.state().pressed == ("A",), "the button that is held here")

    side.hand.a = False
    stops_by_its_key()
    assert wait_for(lambda: side.reason.startswith("emergency stop"), LOOKED_AT_S), side.reason
