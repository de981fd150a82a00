"""Frames through shared memory: whole or not at all, and none unheard of."""

from __future__ import annotations

import mmap
from collections.abc import Iterator

import numpy as np
import pytest

from tams_app.records import Image
from tams_app.video.frame_ring import (
    CAPTURED,
    ENTRIES,
    LUMAS,
    SHOWN,
    FrameReader,
    FrameWriter,
    RingLayout,
)
from tams_app.video.ssim import luma_of

pytestmark = pytest.mark.untimed

LAYOUT = RingLayout(("eih", "gt"), 34, 22)


def image(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 255, (22, 34, 3), dtype=np.uint8)


class Rings:
    """A writer and a reader of one ring in a block of its own."""

    def __init__(self) -> None:
        self.block = mmap.mmap(-1, LAYOUT.block_bytes)
        self.writer = FrameWriter(self.block, LAYOUT, "gt", CAPTURED)
        self.reader = FrameReader(self.block, LAYOUT, "gt", CAPTURED)

    def put(self, indices: range) -> None:
        for index in indices:
            self.writer.put(index, 1000 * index, image(index))


@pytest.fixture
def rings() -> Iterator[Rings]:
    rings = Rings()
    yield rings
    rings.block.close()


def test_frames_arrive_once_in_order_as_luma(rings: Rings) -> None:
    rings.put(range(5))
    assert rings.reader.written() == 5
    first = rings.reader.read(3)
    second = rings.reader.read(5)
    assert [(one.index, one.t_ns) for one in first + second] == [(n, 1000 * n) for n in range(5)]
    for one in first + second:
        np.testing.assert_array_equal(one.luma, luma_of(image(one.index)))
    assert rings.reader.read(rings.reader.written()) == []


def test_a_reader_that_falls_behind_misses_frames_but_none_of_their_times(rings: Rings) -> None:
    rings.put(range(LUMAS + 7))
    entries = rings.reader.read(rings.reader.written())
    assert [one.index for one in entries] == list(range(LUMAS + 7))
    assert [one.luma is None for one in entries] == [True] * 7 + [False] * LUMAS
    np.testing.assert_array_equal(entries[-1].luma, luma_of(image(LUMAS + 6)))


def test_what_was_overwritten_for_good_is_left_out(rings: Rings) -> None:
    rings.put(range(ENTRIES + 40))
    entries = rings.reader.read(rings.reader.written())
    assert [one.index for one in entries] == list(range(41, ENTRIES + 40))


def test_a_frame_that_is_being_overwritten_is_not_read(
    rings: Rings, monkeypatch: pytest.MonkeyPatch
) -> None:
    rings.put(range(LUMAS))
    seen = []

    def interrupt(*arguments: object, **others: object) -> None:
        seen.extend(rings.reader.read(1))

    monkeypatch.setattr("tams_app.video.frame_ring.cv2.cvtColor", interrupt)
    rings.put(range(LUMAS, LUMAS + 1))
    assert [(one.index, one.luma) for one in seen] == [(0, None)]


def test_rings_do_not_touch_each_other() -> None:
    with mmap.mmap(-1, LAYOUT.block_bytes) as block:
        places = [(view, kind) for view in LAYOUT.views for kind in (CAPTURED, SHOWN)]
        writers = [FrameWriter(block, LAYOUT, *place) for place in places]
        readers = [FrameReader(block, LAYOUT, *place) for place in places]
        for _ in range(2 * LUMAS):
            for number, writer in enumerate(writers):
                writer.put(number, number, image(number))
        for number, reader in enumerate(readers):
            entries = reader.read(reader.written())
            assert {one.index for one in entries} == {number}
            np.testing.assert_array_equal(entries[-1].luma, luma_of(image(number)))


def test_a_frame_of_another_size_is_refused(rings: Rings) -> None:
    with pytest.raises(ValueError, match=r"\(22, 34, 3\)"):
        rings.writer.put(0, 0, np.zeros((22, 35, 3), np.uint8))
    assert rings.reader.written() == 0
