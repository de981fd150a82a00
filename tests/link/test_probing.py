"""Measuring a link: echoes and trains, through a bottleneck of known rate."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.probing import (
    PART,
    PONG,
    Answering,
    TrainReceiver,
    ask,
    numbers_of,
    ping,
    report_of,
    train_of,
)
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed


def test_an_echo_comes_back_with_its_number():
    (answer,) = Answering().answers(ping(17), 0, 100)
    assert numbers_of(answer, PONG) == (17, 0)


def test_a_train_that_is_asked_for_comes_whole_and_at_most_once_as_long_as_allowed():
    train = Answering().answers(ask(3, 50), 0, 100)
    assert [numbers_of(one, PART) for one in train] == [(3, 50)] * 50
    assert len(Answering().answers(ask(3, 1 << 31), 0, 100)) == 400


@given(rate_kbps=st.floats(200, 50_000), burst_parts=st.integers(0, 100))
def test_the_rate_of_a_bottleneck_is_read_behind_the_burst_that_it_lets_through(
    rate_kbps: float, burst_parts: int
):
    parts, size_bytes, answering = 300, 1200, Answering()
    per_part_ns = round(size_bytes * 8e6 / rate_kbps)
    for number, part in enumerate(train_of(1, parts)):
        now_ns = max(0, number - burst_parts) * per_part_ns
        (told,) = answering.answers(part, now_ns, size_bytes)
    report = report_of(told)
    assert report.packets == parts
    assert report.kbps == pytest.approx(rate_kbps, rel=0.01)


def test_a_second_train_is_counted_by_itself():
    answering = Answering()
    for part in train_of(1, 10):
        answering.answers(part, 0, 1200)
    (told,) = answering.answers(train_of(2, 10)[0], NS_PER_S, 1200)
    assert (report_of(told).train, report_of(told).packets) == (2, 1)


@pytest.mark.parametrize("came", [0, 1, 2])
def test_too_short_a_train_tells_no_rate(came: int):
    receiver = TrainReceiver(1, 300)
    for number in range(came):
        receiver.part(number, 1200)
    assert receiver.report().kbps is None


@given(st.binary(max_size=60))
def test_what_is_no_measurement_is_answered_by_nothing(message: bytes):
    kinds = (b"\0ping", b"\0ask", b"\0part")
    if not message.startswith(kinds):
        assert Answering().answers(message, 0, 100) == []
    assert report_of(message) is None
