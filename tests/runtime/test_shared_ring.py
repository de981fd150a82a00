"""Rings in shared memory: a record comes whole or not at all."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Iterable, Iterator

import pytest

from tams_app.runtime.shared_ring import Bulk, RingShape, SharedRing

pytestmark = pytest.mark.untimed

SHAPE = RingShape(head_bytes=24, heads=8, bulk_bytes=100, bulks=4)
START = 128


def head_of(number: int) -> bytes:
    return bytes([number % 256]) * SHAPE.head_bytes


def put(ring: SharedRing, number: int) -> None:
    ring.put(head_of(number), lambda bulk: bulk.fill(number))


def put_all(ring: SharedRing, numbers: Iterable[int]) -> None:
    for number in numbers:
        put(ring, number)


@pytest.fixture
def memory() -> Iterator[mmap.mmap]:
    with mmap.mmap(-1, START + 2 * SHAPE.size) as memory:
        yield memory


@pytest.fixture
def ring(memory: mmap.mmap) -> SharedRing:
    return SharedRing(memory, SHAPE, START)


def test_records_are_read_as_they_were_put(memory: mmap.mmap, ring: SharedRing) -> None:
    reader = SharedRing(memory, SHAPE, START)
    put_all(ring, range(4))
    assert reader.written() == 4
    for number in range(4):
        bulk = reader.bulk(number)
        assert reader.head(number) == head_of(number)
        assert bulk is not None
        assert (bulk == number).all()
    assert reader.newest() == (3, head_of(3))


def test_an_empty_ring_holds_nothing(ring: SharedRing) -> None:
    assert ring.written() == 0
    assert ring.newest() is None
    assert ring.head(0) is None
    assert ring.bulk(0) is None


def test_heads_outlast_bulks_and_what_is_not_there_is_none(ring: SharedRing) -> None:
    put_all(ring, range(20))
    numbers = range(30)
    assert [n for n in numbers if ring.head(n) is not None] == list(range(12, 20))
    assert [n for n in numbers if ring.bulk(n) is not None] == list(range(16, 20))


def test_a_copy_stays_what_it_was(ring: SharedRing) -> None:
    put(ring, 0)
    bulk = ring.bulk(0)
    assert bulk is not None
    put_all(ring, range(1, 9))
    assert (bulk == 0).all()


def test_a_record_that_is_being_written_is_not_there(ring: SharedRing) -> None:
    put_all(ring, range(4))
    seen: list[object] = []

    def fill(bulk: Bulk) -> None:
        bulk[:50] = 4
        seen.extend((ring.written(), ring.head(4), ring.bulk(4), ring.bulk(0), ring.newest()))

    ring.put(head_of(4), fill)
    assert seen == [4, None, None, None, (3, head_of(3))]


def slowly(meanwhile: Callable[[], None]) -> Callable[[Bulk], Bulk]:
    """Copies a bulk while `meanwhile` happens."""

    def read(bulk: Bulk) -> Bulk:
        meanwhile()
        return bulk.copy()

    return read


def test_a_bulk_overwritten_during_the_copy_is_thrown_away(ring: SharedRing) -> None:
    put(ring, 0)
    assert ring.bulk(0, slowly(lambda: put_all(ring, range(1, SHAPE.bulks + 1)))) is None


def test_a_bulk_finished_during_the_copy_is_thrown_away(
    memory: mmap.mmap, ring: SharedRing
) -> None:
    put(ring, 0)
    at = ring._bulk_at(0)
    finished, memory[at] = memory[at], 1  # still being written
    assert ring.bulk(0, slowly(lambda: memory.__setitem__(at, finished))) is None


@pytest.mark.parametrize("position", [0, 3, 8, 20, 31])
def test_a_torn_head_gives_the_record_before(
    memory: mmap.mmap, ring: SharedRing, position: int
) -> None:
    put_all(ring, range(3))
    at = ring._head_at(2) + position
    memory[at] ^= 0x55
    assert ring.head(2) is None
    assert ring.newest() == (1, head_of(1))


def test_a_killed_writer_leaves_what_was_whole_and_its_successor_goes_on(
    memory: mmap.mmap, ring: SharedRing
) -> None:
    put_all(ring, range(3))

    def killed(_bulk: Bulk) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ring.put(head_of(3), killed)
    assert ring.newest() == (2, head_of(2))
    successor = SharedRing(memory, SHAPE, START)
    put(successor, 3)
    assert ring.newest() == (3, head_of(3))
    assert ring.bulk(3) is not None


def test_rings_side_by_side_do_not_touch_each_other(memory: mmap.mmap, ring: SharedRing) -> None:
    other = SharedRing(memory, SHAPE, START + SHAPE.size)
    for number in range(10):
        put(ring, number)
        other.put(bytes(SHAPE.head_bytes), lambda bulk: bulk.fill(255))
    assert ring.newest() == (9, head_of(9))
    assert {int(ring.bulk(n).max()) for n in range(6, 10)} == {6, 7, 8, 9}  # type: ignore[union-attr]
    assert bytes(memory[:START]) == bytes(START)


def test_a_ring_without_bulks_keeps_heads_only() -> None:
    shape = RingShape(head_bytes=8, heads=2)
    with mmap.mmap(-1, shape.size) as memory:
        ring = SharedRing(memory, shape)
        for number in range(5):
            ring.put(bytes([number]) * 8)
        assert ring.newest() == (4, bytes([4]) * 8)
        assert ring.head(2) is None
