"""The relay that tests of the link stand on does what its conditions say."""

import socket

import pytest

from tams_app.units import NS_PER_MS
from tests.impaired_link import Conditions, ImpairedLink, Way

pytestmark = pytest.mark.waiting

MS = NS_PER_MS


def way(**conditions: object) -> Way:
    return Way(Conditions(**conditions), seed=1)  # type: ignore[arg-type]


def numbered(count: int) -> list[bytes]:
    return [number.to_bytes(2, "big") for number in range(count)]


def offer(one: Way, datagrams: list[bytes], period_ns: int = MS) -> None:
    for number, datagram in enumerate(datagrams):
        one.offer(number * period_ns, datagram)


def test_a_datagram_leaves_after_the_latency_and_no_sooner():
    one = way(latency_ms=20.0)
    one.offer(0, b"a")
    assert one.due(20 * MS - 1) == []
    assert one.due(20 * MS) == [b"a"]


def test_jitter_delays_and_keeps_the_order():
    one = way(latency_ms=20.0, jitter_ms=10.0)
    datagrams = numbered(500)
    offer(one, datagrams)
    soon = one.due(519 * MS)
    assert 0 < len(soon) < len(datagrams)
    assert soon + one.due(700 * MS) == datagrams


def test_what_is_held_leaves_in_one_burst_and_in_order():
    one = way(passage="hold")
    offer(one, numbered(100))
    assert one.due(2000 * MS) == []
    one.becomes(Conditions(), 2000 * MS)
    assert one.due(2000 * MS) == numbered(100)


def test_a_cut_loses_what_was_held_what_is_on_its_way_and_what_comes():
    one = way(latency_ms=20.0)
    one.offer(0, b"on its way")
    one.becomes(Conditions(passage="hold"), 1)
    one.offer(1, b"held")
    one.becomes(Conditions(passage="cut"), 2)
    one.offer(2, b"new")
    one.becomes(Conditions(), 3)
    assert one.due(1000 * MS) == []


@pytest.mark.parametrize(("name", "least", "most"), [("loss", 650, 750), ("duplicate", 1250, 1350)])
def test_about_the_given_fraction_is_lost_or_comes_twice(name: str, least: int, most: int):
    one = way(**{name: 0.3})
    offer(one, numbered(1000))
    assert least <= len(one.due(10_000 * MS)) <= most


def test_one_that_is_reordered_is_overtaken():
    one = way(reorder=0.3)
    offer(one, numbered(1000))
    out = one.due(10_000 * MS)
    assert out != numbered(1000)
    assert sorted(out) == numbered(1000)


def test_the_process_passes_on_and_back_moves_and_plays_everything_again():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        robot.settimeout(10.0)
        with (
            ImpairedLink(robot.getsockname()) as link,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as operator,
        ):
            operator.connect(("127.0.0.1", link.port))
            operator.settimeout(10.0)

            def passes(content: bytes) -> int:
                operator.send(content)
                got, address = robot.recvfrom(100)
                assert got == content
                robot.sendto(content, address)
                assert operator.recv(100) == content
                return int(address[1])

            first = passes(b"one")
            link.move()
            second = passes(b"two")
            link.replay()
            again = [robot.recvfrom(100) for _ in range(2)]
    assert first != second
    assert [content for content, _ in again] == [b"one", b"two"]
    assert all(address[1] not in (first, second) for _, address in again)
