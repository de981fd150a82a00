"""What the headset reports as seen is what SteamVR has taken, by a virtual clock."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tams_app.config import HeadsetConfig
from tams_app.errors import DeviceError
from tams_app.faces.application import Opened
from tams_app.faces.headset.display import HeadsetDisplay
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS
from tests.faces.window.facts import OPENING

pytestmark = pytest.mark.untimed


class Frames:
    """One view's frames, in place of a `FrameReader`."""

    def __init__(self) -> None:
        self.put, self.overwritten = 0, False

    def written(self) -> int:
        return self.put

    def newest_put_ns(self) -> int:
        return self.put

    def newest_frame(self) -> Any:
        image = np.zeros((OPENING.height, OPENING.width, 3), np.uint8)
        return None if self.overwritten else (self.put, image)


class Shown:
    """A display over overlays that take each texture, or refuse it."""

    def __init__(self) -> None:
        self.clock, self.refuses = VirtualClock(), False
        self.frames = {view: Frames() for view in OPENING.views}
        nothing = SimpleNamespace(newer=lambda _now_ns: None)
        opened: Any = Opened(OPENING, self.frames, nothing)  # type: ignore[arg-type]
        nop = lambda *_: None  # noqa: E731
        texture: Any = SimpleNamespace(create=nop, put=nop, flush=nop, handle=1)
        overlays: Any = SimpleNamespace(arrange=nop, crop=nop, submit=self._submit)
        self.display = HeadsetDisplay(opened, HeadsetConfig(), overlays, texture, self.clock)
        self.large, self.small = OPENING.views[:2]
        for frames in self.frames.values():
            frames.put = 1
        self.step()

    def _submit(self, *_: object) -> None:
        if self.refuses:
            raise DeviceError("refused")

    def step(self, after_ms: int = 0) -> bool:
        """Go on, and look; whether what there was then is seen."""
        self.clock.advance_ns(after_ms * NS_PER_MS)
        self.display.step(self.clock.now_ns())
        return self.display.seen_ns == {view: one.put for view, one in self.frames.items()}


def test_a_frame_whose_drawing_is_put_off_is_not_seen_before_it_is_drawn() -> None:
    shown = Shown()
    assert shown.display.drawings == 1
    shown.frames[shown.small].put += 1
    while not shown.step(8):
        assert shown.display.drawings == 1
    assert shown.display.drawings == 2


def test_a_frame_of_the_large_view_is_seen_at_once_and_nothing_new_hides_nothing() -> None:
    shown = Shown()
    for _ in range(10):
        shown.frames[shown.large].put += 1
        assert shown.step(33)
    shown.step(100)
    drawn = shown.display.drawings
    assert all(shown.step(8) for _ in range(100))
    assert shown.display.drawings == drawn


def test_a_frame_that_steamvr_refuses_or_that_was_overwritten_is_not_seen() -> None:
    shown = Shown()
    shown.frames[shown.small].put += 1
    shown.frames[shown.small].overwritten = True
    assert not shown.step(100)
    shown.frames[shown.small].overwritten = False
    assert shown.step(100)
    shown.refuses = True
    shown.frames[shown.large].put += 1
    before = shown.display.seen_ns
    with pytest.raises(DeviceError):
        shown.step(100)
    assert shown.display.seen_ns == before
