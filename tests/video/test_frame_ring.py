"""Frames through shared memory: whole or not at all, and none unheard of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tams_app.records import Image, TaskRegion
from tams_app.runtime.shared_ring import open_block
from tams_app.video.core.ssim import luma_of
from tams_app.video.live.frame_ring import (
    CAPTURED,
    ENTRIES,
    IMAGES,
    SHOWN,
    FrameBlock,
    FrameReader,
    RingLayout,
)

pytestmark = pytest.mark.untimed

LAYOUT, COLOUR = (RingLayout(kind, ("eih", "gt"), 34, 22) for kind in (CAPTURED, SHOWN))


def image(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 255, (22, 34, 3), dtype=np.uint8)


class Rings:
    """A block, and a reader of one of its rings."""

    def __init__(self, layout: RingLayout) -> None:
        self.block = FrameBlock(layout)
        self.block.create()
        self.memory = open_block(self.block.name)
        self.reader = FrameReader(self.memory, layout, "gt")

    def put(self, indices: range) -> None:
        for index in indices:
            self.block.put("gt", index, 1000 * index, image(index))

    def close(self) -> None:
        self.memory.close()
        self.block.close()


@pytest.fixture(params=[LAYOUT, COLOUR], ids=lambda layout: layout.kind)
def rings(request: pytest.FixtureRequest) -> Iterator[Rings]:
    rings = Rings(request.param)
    yield rings
    rings.close()


def test_frames_arrive_once_in_order_as_luma(rings: Rings) -> None:
    rings.put(range(5))
    assert rings.reader.written() == 5
    first = rings.reader.read(3)
    second = rings.reader.read(5)
    assert [(one.index, one.t_ns) for one in first + second] == [(n, 1000 * n) for n in range(5)]
    for one in first + second:
        np.testing.assert_array_equal(one.luma, luma_of(image(one.index)))
    assert rings.reader.read(rings.reader.written()) == []


def test_the_tasks_region_arrives_with_its_frame(rings: Rings) -> None:
    region = TaskRegion(12.25, 3.5, 8.0)
    rings.block.put("gt", 0, 0, image(0), task=region)
    rings.block.put("gt", 1, 1000, image(1))
    entries = rings.reader.read(2)
    assert [one.task for one in entries] == [region, None]


def test_a_reader_that_falls_behind_misses_frames_but_none_of_their_times(rings: Rings) -> None:
    rings.put(range(IMAGES + 7))
    entries = rings.reader.read(rings.reader.written())
    assert [one.index for one in entries] == list(range(IMAGES + 7))
    assert [one.luma is None for one in entries] == [True] * 7 + [False] * IMAGES
    np.testing.assert_array_equal(entries[-1].luma, luma_of(image(IMAGES + 6)))


def test_what_was_overwritten_for_good_is_left_out(rings: Rings) -> None:
    rings.put(range(ENTRIES + 40))
    entries = rings.reader.read(rings.reader.written())
    assert [one.index for one in entries] == list(range(41, ENTRIES + 40))


def test_the_newest_frame_shown_is_there_in_colour() -> None:
    rings = Rings(COLOUR)
    assert rings.reader.newest_frame() is None
    rings.put(range(IMAGES + 3))
    np.testing.assert_array_equal(rings.reader.newest_frame()[1], image(IMAGES + 2))
    assert len(rings.reader.read(2)) == 2  # which the reader in order does not miss by this
    rings.close()


def test_other_processes_can_read_what_is_put_into_a_block_until_it_is_hidden_or_closed() -> None:
    block = FrameBlock(COLOUR)
    block.put("gt", 0, 0, image(0))  # before it is there: left out
    block.create()
    block.put("gt", 1, 1000, image(1))
    block.create()  # it is there already, with all that was put
    with open_block(block.name) as memory:
        reader = FrameReader(memory, COLOUR, "gt")
        np.testing.assert_array_equal(reader.newest_frame()[1], image(1))
        block.hide()
        with pytest.raises(FileNotFoundError):
            open_block(block.name)
        block.put("gt", 2, 2000, image(2))
        assert [one.index for one in reader.read(reader.written())] == [1, 2]
    block.close()
    block.close()
    block.put("gt", 3, 3000, image(3))  # after the end: left out
    unhidden = FrameBlock(LAYOUT)
    unhidden.create()
    unhidden.close()
    with pytest.raises(FileNotFoundError):
        open_block(unhidden.name)


def test_rings_do_not_touch_each_other(rings: Rings) -> None:
    layout = rings.block.layout
    for _ in range(2 * IMAGES):
        for number, view in enumerate(layout.views):
            rings.block.put(view, number, number, image(number))
    for number, view in enumerate(layout.views):
        reader = FrameReader(rings.memory, layout, view)
        entries = reader.read(reader.written())
        assert {one.index for one in entries} == {number}
        np.testing.assert_array_equal(entries[-1].luma, luma_of(image(number)))


def test_a_frame_of_another_size_is_refused(rings: Rings) -> None:
    with pytest.raises(ValueError, match=r"\(22, 34, 3\)"):
        rings.block.put("gt", 0, 0, np.zeros((22, 35, 3), np.uint8))
    assert rings.reader.written() == 0
