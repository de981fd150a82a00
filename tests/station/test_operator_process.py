"""The simulated operator's process: what they see is what is on the screen, and nothing else."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hw.sim.layout import draw_layout
from hw.sim.world.rig_memory import WorldWriter, remove_memory
from hw.sim.world.world import World
from tams_app.config import load_config
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Image
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.runtime.parts import Parts
from tams_app.runtime.shared_ring import new_block_name
from tams_app.station.rig_operator import RigOperator
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.hw.sim.operator.scripted_pick import READY
from tests.rig_views import stored_views
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.waiting

SEED = 5  # of the stored views' scene
VIEWS = ("eih", "gt", "gs")
TICK_NS = 10 * NS_PER_MS
WITHIN_S = 30.0  # generous: the machine may be busy
MOVED_M = 0.02


def _shared_memory() -> list[Path]:
    """Of this process."""
    return list(Path("/dev/shm").glob(f"tams-{os.getpid()}-*"))


class Person:
    """An operator's process, a screen before them, and what comes of the two."""

    def __init__(self, logs: Path, kind: str) -> None:
        config = load_config(None, {"rig.operator.kind": kind, "seed": SEED})
        self.clock = MonotonicClock()
        self.screen = FrameBlock(RingLayout(SHOWN, VIEWS, 640, 480))
        self.world_memory = new_block_name()
        self._blocks = set(_shared_memory())
        log = MemoryJournal(VirtualClock())
        self.glances = log.records
        screen: Any = SimpleNamespace(frames=self.screen, mount=None)
        self.failures: list[str] = []
        self.images: dict[str, Image] = {}
        self._index = 0
        self._operator = RigOperator(
            config,
            self.clock,
            Parts(logs, self.failures.append, priority=0),
            log,
            screen,
            confirms=False,
            world_memory=self.world_memory,
        )
        self.controller = self._operator.controller

    def start(self) -> None:
        self.process = self._operator.launch()
        self._operator.wait_ready()
        self.kind = self._operator.kind
        self.screen.hide()
        self.controller.start()

    def run(self, seconds: float) -> list[ControllerSample]:
        """What the controller said meanwhile, while the screen shows `images`, 25 a second."""
        samples: list[ControllerSample] = []
        self.until(lambda sample: bool(samples.append(sample)), seconds)
        return samples

    def until(
        self, holds: Callable[[ControllerSample], bool], within_s: float = WITHIN_S
    ) -> ControllerSample | None:
        """The first sample that `holds`; None when none has come in time."""
        start_ns = self.clock.now_ns()
        for number in range(round(within_s * NS_PER_S / TICK_NS)):
            if number % 4 == 0:
                self._show()
            now_ns = start_ns + number * TICK_NS
            self.clock.sleep_until_ns(now_ns)
            sample = self.controller.sample(now_ns)
            if holds(sample):
                return sample
        return None

    def close(self) -> None:
        self._operator.close()
        self.screen.close()
        remove_memory(self.world_memory)
        assert set(_shared_memory()) <= self._blocks, "nothing is left in memory"

    def _show(self) -> None:
        self._index += 1
        for view, image in self.images.items():
            self.screen.put(view, self._index, self.clock.now_ns(), image)


@pytest.fixture
def seeing(tmp_path: Path) -> Iterator[Person]:
    """There is no simulated world at all: they cannot know where things are but by looking."""
    person = Person(tmp_path, "seeing")
    person.start()
    yield person
    person.close()


def position(sample: ControllerSample) -> np.ndarray:
    assert sample.pose is not None
    return sample.pose.position


def engages(person: Person) -> np.ndarray:
    """The operator squeezes and is told that the arm follows; where the hand was."""
    sample = person.until(lambda sample: sample.trigger == 1.0)
    assert sample is not None, "the operator never squeezed the trigger"
    person.controller.pulse(Haptic.ENGAGE)
    return position(sample)


def test_before_a_dark_screen_an_operator_does_nothing_and_lets_go_when_images_freeze(
    seeing: Person,
) -> None:
    """The same frames again and again, as a decoder shows them whose packets no longer come."""
    samples = seeing.run(1.0)
    assert {sample.status for sample in samples} == {ControllerStatus.OK}
    assert {sample.trigger for sample in samples} == {0.0}
    assert not any(sample.menu or sample.a or sample.b for sample in samples)
    assert seeing.glances == []
    seeing.images = stored_views()
    start = engages(seeing)
    moved = seeing.until(lambda one: bool(np.linalg.norm(position(one) - start) > 0.006))
    assert moved is not None, "the operator did not reach for what they saw"
    assert seeing.until(lambda sample: sample.trigger == 0.0) is not None, "they moved on blindly"
    last = seeing.glances[-1]
    assert any(set(glance.hanging) == set(VIEWS) for glance in seeing.glances), last
    times = [glance.t_ns for glance in seeing.glances]
    assert len(times) >= 5
    assert times == sorted(set(times))
    assert seeing.failures == []


def test_the_scripted_operator_moves_before_a_dark_screen(tmp_path: Path) -> None:
    person = Person(tmp_path, "scripted")
    world = World(draw_layout(SEED), READY)
    writer = WorldWriter(person.world_memory)
    try:
        person.start()
        assert person.kind == "scripted"

        def publish(sample: ControllerSample) -> bool:
            writer.publish(person.clock.now_ns(), world.state())
            return sample.trigger == 1.0

        squeezed = person.until(publish)
        assert squeezed is not None
        person.controller.pulse(Haptic.ENGAGE)
        start = position(squeezed)

        def reaches(sample: ControllerSample) -> bool:
            publish(sample)
            return bool(np.linalg.norm(position(sample) - start) > MOVED_M)

        assert person.until(reaches) is not None
        assert person.glances == []
    finally:
        person.close()
        writer.close()


def test_a_killed_process_is_a_runtime_that_has_quit_and_a_failure(seeing: Person) -> None:
    assert seeing.process.pid is not None
    os.kill(seeing.process.pid, signal.SIGKILL)
    sample = seeing.until(lambda sample: sample.status is not ControllerStatus.OK)
    assert sample is not None
    assert sample.status is ControllerStatus.RUNTIME_QUIT
    assert (sample.pose, sample.trigger) == (None, 0.0)
    assert seeing.until(lambda _: bool(seeing.failures)) is not None
    assert "operator's process ended unasked" in str(seeing.failures[0])


def test_a_stopped_process_leaves_samples_that_grow_old(seeing: Person) -> None:
    pid = seeing.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        seeing.run(0.2)  # what was published before has been read
        samples = seeing.run(0.5)
        assert len({sample.buttons_ns for sample in samples}) == 1
        assert samples[-1].status is ControllerStatus.OK
    finally:
        os.kill(pid, signal.SIGCONT)
    old_ns = samples[-1].buttons_ns
    assert seeing.until(lambda sample: sample.buttons_ns > old_ns) is not None


def test_an_operator_without_the_rig_s_world_must_see_whatever_is_configured(
    tmp_path: Path,
) -> None:
    config = load_config(None, {"rig.operator.kind": "scripted"})
    frames = FrameBlock(RingLayout(SHOWN, VIEWS, 640, 480))
    screen: Any = SimpleNamespace(frames=frames, mount=None)
    operator = RigOperator(
        config,
        MonotonicClock(),
        Parts(tmp_path, lambda _sentence: None, priority=0),
        MemoryJournal(VirtualClock()),
        screen,
    )
    assert operator.kind == "seeing"
    operator.close()
