"""The order in which things happen."""

from __future__ import annotations

from tams_app.video.lockstep.agenda import Agenda


def drain(agenda: Agenda) -> None:
    while agenda.next_ns is not None:
        agenda.do_next()


def test_actions_are_done_in_the_order_of_time() -> None:
    agenda, done = Agenda(), list[int]()
    for due_ns in (30, 10, 20):
        agenda.post(due_ns, lambda due_ns=due_ns: done.append(due_ns))
    assert agenda.next_ns == 10
    drain(agenda)
    assert done == [10, 20, 30]


def test_actions_of_the_same_time_are_done_in_the_order_of_posting() -> None:
    agenda, done = Agenda(), list[int]()
    for number in range(20):
        agenda.post(5, lambda number=number: done.append(number))
    drain(agenda)
    assert done == list(range(20))
