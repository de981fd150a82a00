"""How often the window draws, against a processor that is simulated."""

from __future__ import annotations

import pytest

from tams_app.faces.views import EARLY_NS, FOLLOWS_NS, LEAST_NS, MOST_NS, SHARE, DrawPacer
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

_LOOK_NS = 8 * NS_PER_MS


def run(cost_ns: int, seconds: float, idle_cost: float) -> tuple[float, float]:
    """Drawings a second, and the share of a core that they take, once settled.

    `idle_cost`: share of a core that the process needs besides.
    """
    pacer = DrawPacer(0, 0)
    used_ns, drawings, settled_used_ns = 0.0, 0, 0.0
    half = round(seconds * NS_PER_S / 2)
    for now_ns in range(0, 2 * half, _LOOK_NS):
        used_ns += _LOOK_NS * idle_cost
        if pacer.may_draw(now_ns, int(now_ns * 30.0 / NS_PER_S)):
            used_ns += cost_ns
            pacer.drawn(now_ns, round(used_ns))
            drawings += now_ns >= half
        if now_ns < half:
            settled_used_ns = used_ns
    return drawings / (seconds / 2), (used_ns - settled_used_ns) / half


@pytest.mark.parametrize(
    ("cost_ms", "idle_cost", "least", "most"),
    [
        (1, 0.0, 30.0, 60.0),  # every frame of thirty a second
        (25, 0.0, 5.0, 15.0),  # dear: less often
        (2000, 0.0, 0.9 * NS_PER_S / MOST_NS - 1, 15.0),  # however dear it is, something
        (5, 0.4, 3.0, 60.0),  # other work of the process does not stop the drawing
    ],
)
def test_it_draws_as_often_as_its_cost_allows(
    cost_ms: int, idle_cost: float, least: float, most: float
) -> None:
    per_second, share = run(cost_ms * NS_PER_MS, 20, idle_cost)
    assert least <= per_second < most
    assert cost_ms != 25 or share == pytest.approx(SHARE, rel=0.25)


def test_nothing_is_drawn_before_it_is_time() -> None:
    pacer = DrawPacer(0, 0)
    pacer.drawn(0, 0)
    assert not pacer.may_draw(LEAST_NS - EARLY_NS - 1, 1)
    assert pacer.may_draw(LEAST_NS - EARLY_NS, 2)


def test_what_is_no_new_frame_of_the_large_picture_waits_for_one() -> None:
    pacer = DrawPacer(0, 0)
    pacer.drawn(0, 0)
    due_ns = LEAST_NS
    assert pacer.may_draw(due_ns, 1), "it has come just now"
    assert not pacer.may_draw(due_ns, 1), "it came before: the next one is near"
    assert not pacer.may_draw(due_ns + FOLLOWS_NS - 1, 1)
    assert pacer.may_draw(due_ns + FOLLOWS_NS, 1), "no other one comes"


def test_a_frame_of_the_large_picture_is_drawn_when_it_comes_or_not_at_all() -> None:
    """Drawing takes 10 ms of a core: 40 ms apart in the mean, at frames 33 ms apart."""
    period_ns, pacer, used_ns, drawn = NS_PER_S // 30, DrawPacer(0, 0), 0, []
    for now_ns in range(0, 20 * NS_PER_S, NS_PER_MS):
        if pacer.may_draw(now_ns, now_ns // period_ns):
            used_ns += 10 * NS_PER_MS
            pacer.drawn(now_ns, used_ns)
            drawn.append(now_ns)
    settled = [now_ns for now_ns in drawn if now_ns >= 10 * NS_PER_S]
    assert max(now_ns % period_ns for now_ns in settled) <= NS_PER_MS
    assert len(settled) / 10 == pytest.approx(25, rel=0.05)
