"""The window of the operator's side, with the robot's side as a process of its own."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rich.console import Console

from tams_app.console import app
from tams_app.records import Image
from tams_app.teleop.safety import ArmingState
from tests.console.window.photographs import SAME, banner_is, difference
from tests.console.window.xvfb import Screen, virtual_screen, wait_for
from tests.faults.applications import until
from tests.faults.two_sides import HandSide, RobotSide

pytestmark = [
    pytest.mark.timed,
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]

ATTEMPTS = 5
LOOKED_AT_S = 15.0


def test_it_shows_what_was_received_and_what_only_the_robots_side_knows_and_its_keys_stop_the_arm(
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
                side.session.end("driven")

        with ThreadPoolExecutor(1) as pool:
            driven = pool.submit(drive)
            app.show_session(side.session, Console(quiet=True))
            driven.result()
        assert side.session.failure == ""


def _drive(side: HandSide, screen: Screen) -> None:
    session = side.session
    until(lambda: side.state is not None, "the robot's state")
    screen.focus("TAMS")

    def received(view: str) -> Image | None:
        shown = None if session._video is None else session._video.shown(view)
        return None if shown is None else shown.image

    def shows_all() -> bool:
        photograph = screen.photograph()
        images = {view: received(view) for view in session.config.video.views}
        return banner_is(photograph, "engaged") and all(
            image is not None and difference(photograph, view, image) < SAME
            for view, image in images.items()
        )

    def shows_all_while_engaged() -> bool:
        side.engages()  # the machine's load may stop the arm before the window was looked at
        return wait_for(shows_all, LOOKED_AT_S)

    assert any(shows_all_while_engaged() for _ in range(ATTEMPTS))

    def has_the_robots_figures() -> bool:
        now = session.snapshot()
        rates = now.link_kbps, *(view.sent_kbps for view in now.views.values())
        others = now.budget_kbps, now.queue_ms, now.loss
        ages = [view.shown_age_ms for view in now.views.values()]
        return all(rates) and all(ages) and None not in others

    until(has_the_robots_figures, "what only the robot's side knows")
    side.hand.a = True
    until(lambda: session.snapshot().pressed == ("A",), "the button that is held here")

    def stops_by_its_key() -> bool:
        side.hand.a = False
        side.engages()  # a fault by the machine's load keeps its own reason: then again
        screen.xdotool("key", "space")
        return wait_for(lambda: side.reason.startswith("emergency stop"), LOOKED_AT_S)

    assert any(stops_by_its_key() for _ in range(ATTEMPTS))
    assert side.arming == ArmingState.FAULT
    assert wait_for(lambda: banner_is(screen.photograph(), "fault"))
