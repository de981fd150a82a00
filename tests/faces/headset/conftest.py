"""The headset's process on a virtual screen and a faked SteamVR, for all tests of a module."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tams_app.config import CONFIG_DIRECTORY, HeadsetConfig, load_config
from tams_app.faces.client import FaceClient
from tams_app.faces.messages import Beat, Event, Facts
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.headset.steamvr import FAKED, SteamVr, steamvr
from tests.faces.window.facts import FACTS, OPENING
from tests.faces.window.feeding import ArmElsewhere, Feeding, feeding
from tests.faces.window.xvfb import virtual_screen, wait_for


@dataclass
class WornHeadset:
    """A headset's process, what feeds it, what SteamVR got of it, and what it told."""

    client: FaceClient
    block: FrameBlock
    steamvr: SteamVr
    feeder: Feeding
    events: list[Event] = field(default_factory=list)
    _index: int = 0

    def put(self, frames: dict[str, Image]) -> None:
        """New frames of views."""
        self._index += 1
        for view, image in frames.items():
            self.block.put(view, self._index, self._index, image)

    def show(self, facts: Facts) -> None:
        """As by a session that lives, until others are shown."""
        self.feeder.show(facts)

    @property
    def drawings(self) -> int:
        """How often it has drawn so far."""
        return max((beat.drawings for beat in self.events if isinstance(beat, Beat)), default=0)


@contextmanager
def worn_headset(folder: Path, arm: ArmElsewhere | None = None) -> Iterator[WornHeadset]:
    """With the default configuration; `arm`: whose frames it shows."""
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    layout = RingLayout(SHOWN, OPENING.views, OPENING.width, OPENING.height)
    block, mount = (FrameBlock(layout), None) if arm is None else (arm.block, arm.mount)
    with (
        pytest.MonkeyPatch.context() as patch,
        virtual_screen(folder, patch),
        steamvr(folder, patch) as found,
    ):
        client = FaceClient(MonotonicClock(), FAKED)
        client.launch(folder, headset=HeadsetConfig().model_dump())
        client.open(config, block, blind=False, mount=mount)
        with feeding(client) as feeder:
            worn, stop = WornHeadset(client, block, found, feeder), threading.Event()
            hearing = threading.Thread(target=client.body(worn.events.append), args=(stop,))
            hearing.start()
            assert wait_for(lambda: len(found.overlays()) > len(OPENING.views))  # and the panel
            worn.show(FACTS)
            assert wait_for(lambda: found.seen("tams.panel").size > 0)
            try:
                yield worn
            finally:
                stop.set()
                hearing.join()
        client.close()
        block.close()


@pytest.fixture(scope="module")
def headset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WornHeadset]:
    with worn_headset(tmp_path_factory.mktemp("headset")) as worn:
        yield worn
