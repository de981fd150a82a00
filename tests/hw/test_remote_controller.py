"""The controller of another process: what the driver makes of that process's end and silence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hw.controller import Controller
from hw.remote_controller import ControllerPublisher, RemoteController
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

TICK_NS = 8 * NS_PER_MS


class Held(Controller):
    """In the other process: the trigger is pressed."""

    def __init__(self) -> None:
        self.calls: list[object] = []

    def start(self) -> None:
        self.calls.append("start")

    def sample(self, now_ns: int) -> ControllerSample:
        return ControllerSample(
            ControllerStatus.OK, None, now_ns, now_ns, 1.0, 0.0, a=True, b=False, menu=False
        )

    def pulse(self, haptic: Haptic) -> None:
        self.calls.append(haptic)

    def close(self) -> None:
        self.calls.append("close")


class AnsweringClock(VirtualClock):
    """While the driver waits, the other process goes on."""

    def __init__(self) -> None:
        super().__init__()
        self.meanwhile: Callable[[int], None] = lambda now_ns: None

    def sleep_until_ns(self, deadline_ns: int) -> None:
        super().sleep_until_ns(deadline_ns)
        self.meanwhile(self.now_ns())


class Ends:
    """The driver, and the other process as long as it `runs`."""

    def __init__(self) -> None:
        self.clock, self.runs, self.name = AnsweringClock(), True, new_block_name()
        self.controller = RemoteController(self.name, self.clock, lambda: self.runs)
        self.held = Held()
        self.publisher = ControllerPublisher(self.name, self.held)

    def start(self) -> None:
        self.clock.meanwhile = self.publisher.step
        self.controller.start()

    def tick(self, publishes: bool = True) -> ControllerSample:
        self.clock.advance_ns(TICK_NS)
        if publishes:
            self.publisher.step(self.clock.now_ns())
        return self.controller.sample(self.clock.now_ns())


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.publisher.close()
    ends.controller.let_go()
    assert not list(Path("/dev/shm").glob(f"{ends.name}*"))


def test_the_end_of_the_other_process_is_the_end_of_the_runtime(ends: Ends) -> None:
    ends.start()
    last = ends.tick()
    ends.runs = False
    sample = ends.tick(publishes=False)
    assert sample.status is ControllerStatus.RUNTIME_QUIT
    assert sample.pose is None
    assert (sample.trigger, sample.a) == (0.0, False)
    assert (sample.pose_ns, sample.buttons_ns) == (last.pose_ns, last.buttons_ns)


def test_what_was_published_before_the_end_counts_once_more(ends: Ends) -> None:
    ends.start()
    ends.runs = False
    assert ends.tick().status is ControllerStatus.OK
    assert ends.tick(publishes=False).status is ControllerStatus.RUNTIME_QUIT


def test_a_process_that_does_not_answer_is_told_at_the_start(ends: Ends) -> None:
    with pytest.raises(DeviceError, match="does not answer"):
        ends.controller.start()
    assert ends.tick().status is ControllerStatus.DISCONNECTED


def test_a_process_that_has_ended_is_told_at_the_start_without_waiting(ends: Ends) -> None:
    ends.runs = False
    before_ns = ends.clock.now_ns()
    with pytest.raises(DeviceError, match="does not answer"):
        ends.controller.start()
    assert ends.clock.now_ns() == before_ns


def test_the_first_sample_after_the_start_is_of_a_controller_taken_up(ends: Ends) -> None:
    ends.publisher.step(ends.clock.now_ns())  # published before anyone asked
    ends.start()
    assert ends.held.calls == ["start"]
    assert ends.controller.sample(ends.clock.now_ns()).status is ControllerStatus.OK


def test_requests_arrive_once_and_in_order(ends: Ends) -> None:
    ends.start()
    ends.controller.pulse(Haptic.ENGAGE)
    ends.controller.pulse(Haptic.FAULT)
    ends.controller.close()
    ends.tick()
    ends.tick()
    assert ends.held.calls == ["start", Haptic.ENGAGE, Haptic.FAULT, "close"]


def test_more_pulses_than_the_memory_holds_lose_the_oldest_only(ends: Ends) -> None:
    ends.start()
    for _ in range(100):
        ends.controller.pulse(Haptic.LIMIT)
    ends.controller.pulse(Haptic.FAULT)
    ends.tick()
    assert ends.held.calls[-1] is Haptic.FAULT
    assert 50 < len(ends.held.calls) < 100


def test_nothing_is_left_of_a_memory_whose_name_was_taken_away(ends: Ends) -> None:
    ends.start()
    ends.controller.hide()
    assert not list(Path("/dev/shm").glob(f"{ends.name}*"))
    assert ends.tick().status is ControllerStatus.OK
