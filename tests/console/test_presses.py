"""Two presses are two presses, whatever a keyboard repeats."""

from __future__ import annotations

import pytest

from tams_app.faces.terminal.keys import Presses
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed


def counted(*times_ms: float) -> list[float]:
    presses = Presses()
    return [at for at in times_ms if presses.counts(round(at * NS_PER_MS))]


@pytest.mark.parametrize("first_repeat_ms", [250, 500, 660])
def test_a_held_key_confirms_once(first_repeat_ms: int) -> None:
    repeats = range(5000 + first_repeat_ms, 60_000, 33)
    assert counted(5000, *repeats) == [5000]


def test_presses_apart_confirm_each() -> None:
    assert counted(0, 700, 1500, 9000) == [0, 700, 1500, 9000]


def test_what_is_too_soon_puts_the_next_one_off() -> None:
    assert counted(0, 500, 1000, 1700) == [0, 1700]


def test_a_read_with_many_is_one() -> None:
    assert counted(100, 100, 100) == [100]
