"""The headset's process on a virtual screen and a faked SteamVR, for all tests of a module."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tams_app.config import HeadsetConfig
from tests.faces.headset.steamvr import FAKED, SteamVr, steamvr
from tests.faces.window.facts import FACTS, OPENING
from tests.faces.window.feeding import ArmElsewhere, FedFace
from tests.faces.window.xvfb import virtual_screen, wait_for


class WornHeadset(FedFace):
    """A headset's process, and what SteamVR got of it."""

    def __init__(self, steamvr: SteamVr, arm: ArmElsewhere | None) -> None:
        super().__init__(FAKED, arm)
        self.steamvr = steamvr


@contextmanager
def worn_headset(folder: Path, arm: ArmElsewhere | None = None) -> Iterator[WornHeadset]:
    """With the default configuration; `arm`: whose frames it shows."""
    with (
        pytest.MonkeyPatch.context() as patch,
        virtual_screen(folder, patch),
        steamvr(folder, patch) as found,
    ):
        worn = WornHeadset(found, arm)
        with worn.opened(folder, headset=HeadsetConfig().model_dump()):
            assert wait_for(lambda: len(found.overlays()) > len(OPENING.views))  # and the panel
            worn.show(FACTS)
            assert wait_for(lambda: found.seen("tams.panel").size > 0)
            yield worn


@pytest.fixture(scope="module")
def headset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WornHeadset]:
    with worn_headset(tmp_path_factory.mktemp("headset")) as worn:
        yield worn
