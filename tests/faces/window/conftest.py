"""The real window on a virtual screen, for all tests of a module."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tams_app.faces.client import WINDOW
from tams_app.faces.commands import Command
from tams_app.faces.messages import CommandRequest, Event, Keys
from tams_app.faces.terminal.keys import REPEAT_NS
from tams_app.faces.window.sight import PAINTED_NS
from tams_app.units import NS_PER_S
from tests.faces.window.feeding import ArmElsewhere, FedFace
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for


class ShownWindow(FedFace):
    """A window on its screen."""

    def __init__(self, screen: Screen, arm: ArmElsewhere | None) -> None:
        super().__init__(WINDOW, arm)
        self.screen = screen
        self._away_ns = 0  # when it last had no focus, or was not seen

    def hear(self, event: Event) -> None:
        super().hear(event)
        if isinstance(event, Keys) and not event.focused:
            self._away_ns = event.t_ns

    def until_presses_count(self) -> None:
        """One sooner may have been down before the focus.

        Which the window lacks while it draws a new layout for longer than 150 ms.
        """
        assert wait_for(lambda: time.monotonic_ns() - self._away_ns > REPEAT_NS + 2 * PAINTED_NS)

    def key(self, *keys: str) -> None:
        """Press each, once a press counts."""
        self.until_presses_count()
        self.screen.xdotool("key", *keys)

    def commands(self) -> list[Command]:
        """What was asked for, in order."""
        return [event.command for event in self.events if isinstance(event, CommandRequest)]


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ShownWindow]:
    """The window of the default configuration at 1280x720, with the focus; its keys count."""
    folder = tmp_path_factory.mktemp("window")
    with (
        pytest.MonkeyPatch.context() as patch,
        virtual_screen(folder, patch) as screen,
        shown_window(folder, screen) as shown,
    ):
        yield shown


@contextmanager
def shown_window(
    folder: Path, screen: Screen, title: str = "TAMS", arm: ArmElsewhere | None = None
) -> Iterator[ShownWindow]:
    """The window on the display of the environment; `title`: of what gets the focus on `screen`.

    `arm`: whose frames it shows.
    """
    shown = ShownWindow(screen, arm)
    with shown.opened(folder):
        screen.focus(title)
        assert wait_for(lambda: shown.client.keys is not None and shown.client.keys.focused)
        time.sleep(REPEAT_NS / NS_PER_S)  # a key sooner may have been down before the focus
        yield shown
