"""How often the window draws, against a processor that is simulated."""

from __future__ import annotations

import pytest

from tams_app.faces.pacing import LEAST_NS, MOST_NS, SHARE, Pacer
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

_LOOK_NS = 8 * NS_PER_MS


def run(cost_ns: int, seconds: float, idle_cost: float = 0.0) -> tuple[float, float]:
    """Drawings a second, and the share of a core that they take, once settled.

    `idle_cost`: share of a core that the process needs besides.
    """
    pacer = Pacer(0, 0)
    used_ns, drawings, settled_used_ns = 0.0, 0, 0.0
    half = round(seconds * NS_PER_S / 2)
    for now_ns in range(0, 2 * half, _LOOK_NS):
        used_ns += _LOOK_NS * idle_cost
        if pacer.may_draw(now_ns):
            used_ns += cost_ns
            pacer.drawn(now_ns, round(used_ns))
            drawings += now_ns >= half
        if now_ns < half:
            settled_used_ns = used_ns
    return drawings / (seconds / 2), (used_ns - settled_used_ns) / half


def test_where_drawing_is_cheap_every_frame_of_thirty_a_second_is_drawn() -> None:
    per_second, _ = run(NS_PER_MS, 10)
    assert per_second >= 30


def test_where_drawing_is_dear_it_draws_less_often_and_keeps_its_share() -> None:
    per_second, share = run(25 * NS_PER_MS, 20)
    assert 5 <= per_second < 15
    assert share == pytest.approx(SHARE, rel=0.25)


def test_however_dear_it_is_something_is_drawn() -> None:
    per_second, _ = run(2 * NS_PER_S, 20)
    assert per_second >= 0.9 * NS_PER_S / MOST_NS - 1


def test_other_work_of_the_process_does_not_stop_the_drawing() -> None:
    per_second, _ = run(5 * NS_PER_MS, 20, idle_cost=0.4)
    assert per_second >= 3


def test_nothing_is_drawn_before_it_is_time() -> None:
    pacer = Pacer(0, 0)
    pacer.drawn(NS_PER_S, 0)
    assert not pacer.may_draw(NS_PER_S + LEAST_NS - 1)
    assert pacer.may_draw(NS_PER_S + LEAST_NS)
