"""The relay that tests of the link stand on does what its conditions say."""

import pytest

from tams_app.units import NS_PER_MS
from tests.impaired_link import Conditions, Way

pytestmark = pytest.mark.waiting

MS = NS_PER_MS


def way(**conditions: object) -> Way:
    return Way(Conditions(**conditions), seed=1)  # type: ignore[arg-type]


def numbered(count: int) -> list[bytes]:
    return [number.to_bytes(2, "big") for number in range(count)]


def offer(one: Way, datagrams: list[bytes], period_ns: int = MS) -> None:
    for number, datagram in enumerate(datagrams):
        one.offer(number * period_ns, datagram)


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
