"""The real window on a virtual screen, for all tests of a module."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.client import WINDOW, FaceClient
from tams_app.faces.commands import Command
from tams_app.faces.messages import CommandRequest, Event, Facts, Keys
from tams_app.faces.terminal.keys import REPEAT_NS
from tams_app.faces.window.sight import PAINTED_NS
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window.facts import OPENING
from tests.faces.window.feeding import ArmElsewhere, Feeding, feeding
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for


@dataclass
class ShownWindow:
    """A window, what feeds it, and what it told."""

    client: FaceClient
    block: FrameBlock
    screen: Screen
    feeder: Feeding
    events: list[Event] = field(default_factory=list)
    _index: int = 0
    _away_ns: int = 0  # when it last had no focus, or was not seen

    def put(self, frames: dict[str, Image]) -> int:
        """New frames of views, decoded now; when that is [ns]."""
        self._index, now_ns = self._index + 1, time.monotonic_ns()
        for view, image in frames.items():
            self.block.put(view, self._index, now_ns, image)
        return now_ns

    def show(self, facts: Facts) -> None:
        """As by a session that lives, until others are shown."""
        self.feeder.show(facts)

    def hear(self, event: Event) -> None:
        self.events.append(event)
        if isinstance(event, Keys) and not event.focused:
            self._away_ns = event.t_ns

    def key(self, *keys: str) -> None:
        """Press each, once a press counts: one sooner may have been down before the focus.

        Which the window lacks while it draws a new layout for longer than 150 ms.
        """
        assert wait_for(lambda: time.monotonic_ns() - self._away_ns > REPEAT_NS + 2 * PAINTED_NS)
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
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    layout = RingLayout(SHOWN, OPENING.views, OPENING.width, OPENING.height)
    block, mount = (FrameBlock(layout), None) if arm is None else (arm.block, arm.mount)
    client = FaceClient(MonotonicClock(), WINDOW)
    client.launch(folder)
    client.open(config, block, blind=False, mount=mount)
    with feeding(client) as feeder:
        shown, stop = ShownWindow(client, block, screen, feeder), threading.Event()
        hearing = threading.Thread(target=client.body(shown.hear), args=(stop,))
        hearing.start()
        screen.focus(title)
        assert wait_for(lambda: client.keys is not None and client.keys.focused)
        time.sleep(REPEAT_NS / NS_PER_S)  # a key sooner may have been down before the focus
        try:
            yield shown
        finally:
            stop.set()
            hearing.join()
    client.close()
    block.close()
