"""Where the mount is, on its way to another process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hw.lite6.kind import Lite6Figure
from tams_app.config import load_config
from tams_app.prediction.plane_warp import covered_by
from tams_app.prediction.present import AsReceived, MountTrail
from tams_app.runtime.shared_ring import map_descriptor, open_block
from tams_app.session.predicting import predicted_cameras
from tams_app.station.mount_memory import MountMemory, PresentViews
from tams_app.units import NS_PER_MS
from tests.prediction.wrist import GRIP, above, camera_of, lens_of, picture, placed
from tests.teleop.rig import PERIOD_NS

pytestmark = pytest.mark.untimed

CAMERAS = {"eih": camera_of(64, 48)}
THEN, NOW = above(0.0, 0.0, 0.20), above(0.02, 0.0, 0.20)
FRAME = picture(lens_of(64, 48), THEN)
AGE_NS = 120 * NS_PER_MS


@pytest.fixture
def memory() -> Iterator[MountMemory]:
    memory = MountMemory(CAMERAS)
    yield memory
    memory.close()


def fill(memory: MountMemory, records: int, first: int = 1) -> int:
    """Put so many beliefs; when the last of them was."""
    for number in range(first, first + records):
        memory.put(placed(number * PERIOD_NS, THEN, NOW, late_ns=40 * NS_PER_MS))
    return (first + records - 1) * PERIOD_NS


def test_a_frame_is_corrected_by_what_was_put(memory: MountMemory) -> None:
    views = PresentViews(CAMERAS, open_block(memory.name))
    assert views.show("eih", FRAME, 1, 1).as_received is AsReceived.UNKNOWN
    now_ns = fill(memory, 60)
    shown = views.show("eih", FRAME, now_ns - AGE_NS, now_ns)
    assert shown.as_received is None
    assert (shown.image != FRAME).any()
    luma = views.show("eih", FRAME[..., 0], now_ns - AGE_NS, now_ns).image
    assert (luma == shown.image[..., 0]).all()


def test_the_arm_s_joints_are_put_where_they_are_known() -> None:
    camera = predicted_cameras(load_config(None, {"view.predict": "all"}))["gs"]
    lens, bent = camera.lens, np.array([0.0, 0.64, 1.51, 0.0, 0.87, 0.0])
    figure, frame = Lite6Figure(), np.full((lens.height, lens.width), 120, np.uint8)
    then, now = (figure.place(joints)[figure.flange] for joints in (bent, bent + 0.2))
    images = []
    for known in ({}, {"then_joints": bent, "now_joints": bent + 0.2}):
        beliefs = [placed(number * PERIOD_NS, then, now, **known) for number in range(1, 61)]
        trail, memory = MountTrail(), MountMemory({"gs": camera})
        for belief in beliefs:
            trail.add(belief)
            memory.put(belief)
        views = PresentViews({"gs": camera}, open_block(memory.name))
        at_ns = 60 * PERIOD_NS - AGE_NS, 60 * PERIOD_NS
        image = views.show("gs", frame, *at_ns).image
        assert (image == camera.view(trail).show(frame, *at_ns).image).all()
        images.append(image)
        memory.close()
    assert (images[1] != frame).sum() > 1.5 * (images[0] != frame).sum(), "the arm, not the tool"


def test_what_was_overwritten_before_it_was_read_is_missed_and_no_more(
    memory: MountMemory,
) -> None:
    views = PresentViews(CAMERAS, map_descriptor(os.dup(memory.descriptor)))
    now_ns = fill(memory, 3000)
    assert views.show("eih", FRAME, now_ns - AGE_NS, now_ns).as_received is None
    now_ns = fill(memory, 30, first=3001)
    assert views.show("eih", FRAME, now_ns - AGE_NS, now_ns).as_received is None


def test_only_the_views_of_cameras_on_the_arm_are_corrected(memory: MountMemory) -> None:
    views = PresentViews(CAMERAS, open_block(memory.name))
    assert "eih" in views
    assert "gt" not in views
    with pytest.raises(KeyError):
        views.show("gt", FRAME, 0, 0)


def test_the_frames_clock_goes_with_what_is_put(memory: MountMemory) -> None:
    views = PresentViews(CAMERAS, open_block(memory.name))
    offset_ns = 10**12
    for number in range(60):
        memory.put(placed(number * PERIOD_NS, THEN, NOW, offset_ns=offset_ns))
    now_ns = 59 * PERIOD_NS
    shown = views.show("eih", FRAME, now_ns + offset_ns - AGE_NS, now_ns)
    assert shown.as_received is None


def test_what_a_closed_gripper_holds_stays_where_it_is(memory: MountMemory) -> None:
    views = PresentViews(CAMERAS, open_block(memory.name))
    held = covered_by((GRIP,), lens_of(64, 48))
    shown = []
    for closed in (False, True):
        for number in range(60):
            now_ns = (60 * closed + number) * PERIOD_NS
            memory.put(placed(now_ns, THEN, NOW, closed=closed))
        shown.append(views.show("eih", FRAME, now_ns - AGE_NS, now_ns).image)
    assert (shown[0][held] != FRAME[held]).any()
    assert (shown[1][held] == FRAME[held]).all()


def test_nothing_is_left_of_the_memory(memory: MountMemory) -> None:
    assert Path("/dev/shm", memory.name).exists()
    memory.hide()
    assert not Path("/dev/shm", memory.name).exists()
    memory.hide()
