"""A tracked controller in another process: samples come through shared memory, pulses go back.

As with a VR runtime, the process that has the controller reads it at a rate of its own, the newest
sample counts, and a process that stops leaves samples that grow old.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from hw.controller import Controller
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose, Presses
from tams_app.rotation import Rotation
from tams_app.runtime.clock import Clock
from tams_app.runtime.shared_ring import (
    RingShape,
    SharedRing,
    create_block,
    open_block,
    remove_block,
)
from tams_app.units import NS_PER_MS, NS_PER_S

_START_TIMEOUT_NS = 5 * NS_PER_S  # the machine may be busy
_POLL_NS = NS_PER_MS

_STATUSES = tuple(ControllerStatus)
_TAKE_UP, _PUT_DOWN = "take up", "put down"  # the controller, into the hand and out of it
_REQUESTS = (_TAKE_UP, _PUT_DOWN, *Haptic)

# Requests met so far, when pose and buttons were new [ns], status, whether there is a pose, the
# pose, trigger and grip, buttons, how often they have gone down.
_SAMPLE = struct.Struct("<3qB?7d2d3?4q")
_REQUEST = struct.Struct("<B")
_SAMPLES = RingShape(_SAMPLE.size, heads=4)
_ASKED = RingShape(_REQUEST.size, heads=64)
_NO_POSE = (0.0,) * 7


class ControllerPublisher:
    """The side of the process that has the controller; it must call `step` again and again."""

    def __init__(self, memory_name: str, controller: Controller) -> None:
        self._controller = controller
        with ExitStack() as stack:
            stack.callback(_remove, memory_name)  # the session that chose it may have been killed
            requests = stack.enter_context(open_block(_requests(memory_name)))
            samples = stack.enter_context(create_block(_samples(memory_name), _SAMPLES.size))
            self._stack = stack.pop_all()
        self._asked = SharedRing(requests, _ASKED)
        self._samples = SharedRing(samples, _SAMPLES)
        self._met = 0

    def step(self, now_ns: int) -> None:
        """Do what was asked since the last call, and publish the controller as it is now."""
        while self._met < self._asked.written():
            head = self._asked.head(self._met)
            self._met += 1
            if head is not None:  # else overwritten: sixty pulses at once are not felt one by one
                self._meet(_REQUESTS[_REQUEST.unpack(head)[0]])
        sample = self._controller.sample(now_ns)
        pose, presses = sample.pose, sample.presses
        self._samples.put(
            _SAMPLE.pack(
                self._met,
                sample.pose_ns,
                sample.buttons_ns,
                _STATUSES.index(sample.status),
                pose is not None,
                *(_NO_POSE if pose is None else (*pose.position, *pose.rotation)),
                sample.trigger,
                sample.grip,
                sample.a,
                sample.b,
                sample.menu,
                presses.grip,
                presses.a,
                presses.b,
                presses.menu,
            )
        )

    def close(self) -> None:
        """Remove the memory and let go of it; may be called twice."""
        self._stack.close()

    def _meet(self, request: str) -> None:
        if request == _TAKE_UP:
            self._controller.start()
        elif request == _PUT_DOWN:
            self._controller.close()
        else:
            self._controller.pulse(Haptic(request))


class RemoteController(Controller):
    """The controller that another process publishes under `memory_name`.

    When that process has ended, the runtime has quit. `sample` and `pulse` are for one thread.
    """

    def __init__(self, memory_name: str, clock: Clock, runs: Callable[[], bool]) -> None:
        """Make the memory; the publisher is to be started after this.

        `runs`: whether the other process does; asked only while nothing new comes of it.
        """
        self._clock = clock
        self._runs = runs
        self._memory_name = memory_name
        with ExitStack() as stack:
            stack.callback(_remove, memory_name)
            requests = stack.enter_context(create_block(_requests(memory_name), _ASKED.size))
            samples = stack.enter_context(create_block(_samples(memory_name), _SAMPLES.size))
            self._memory = stack.pop_all()
        self._asked = SharedRing(requests, _ASKED)
        self._samples = SharedRing(samples, _SAMPLES)
        self._taken_up = False
        self._number = -1  # of the newest sample
        self._met = 0  # requests, when it was taken
        self._last = ControllerSample.released(ControllerStatus.DISCONNECTED)

    def hide(self) -> None:
        """Take the memory's name away, once the publisher works: nothing is left behind then."""
        _remove(self._memory_name)

    def start(self) -> None:
        """Have the controller taken up; DeviceError if the other process does not answer."""
        asked = self._ask(_TAKE_UP)
        deadline_ns = self._clock.now_ns() + _START_TIMEOUT_NS
        while self._met < asked:
            now_ns = self._clock.now_ns()
            if now_ns >= deadline_ns or not self._runs():
                raise DeviceError(
                    "The simulated operator does not answer: see helpers/operator.log in the "
                    "session's folder, then start the session again."
                )
            self._clock.sleep_until_ns(now_ns + _POLL_NS)
            self._read()
        self._taken_up = True

    def sample(self, now_ns: int) -> ControllerSample:
        if not self._taken_up:
            return self._away(ControllerStatus.DISCONNECTED)
        if not self._read() and not self._runs():
            return self._away(ControllerStatus.RUNTIME_QUIT)
        return self._last

    def pulse(self, haptic: Haptic) -> None:
        if self._taken_up:
            self._ask(haptic)

    def close(self) -> None:
        """Have the controller put down; it can be taken up again."""
        if self._taken_up:
            self._taken_up = False
            self._ask(_PUT_DOWN)

    def let_go(self) -> None:
        """Give the memory back, after the last call of anything else; may be called twice."""
        self._taken_up = False
        self._memory.close()

    def _ask(self, request: str) -> int:
        """Put a request; how many there are now."""
        self._asked.put(_REQUEST.pack(_REQUESTS.index(request)))
        return self._asked.written()

    def _away(self, status: ControllerStatus) -> ControllerSample:
        return ControllerSample.released(status, None, self._last.pose_ns, self._last.buttons_ns)

    def _read(self) -> bool:
        """Take the newest sample; whether there was a new one."""
        if self._samples.written() == self._number + 1:
            return False
        newest = self._samples.newest()
        if newest is None or newest[0] == self._number:
            return False
        self._number, head = newest
        self._met, pose_ns, buttons_ns, status, has_pose, *values = _SAMPLE.unpack(head)
        pose, (trigger, grip, a, b, menu) = values[:7], values[7:12]
        self._last = ControllerSample(
            _STATUSES[status],
            self._pose(pose_ns, pose) if has_pose else None,
            pose_ns,
            buttons_ns,
            trigger=trigger,
            grip=grip,
            a=a,
            b=b,
            menu=menu,
            presses=Presses(*values[12:]),
        )
        return True

    def _pose(self, pose_ns: int, numbers: list[float]) -> Pose:
        """The pose of `numbers`; the last sample's where it has not changed."""
        if self._last.pose is not None and pose_ns == self._last.pose_ns:
            return self._last.pose
        return Pose(np.array(numbers[:3]), Rotation(*numbers[3:]))


def _remove(memory_name: str) -> None:
    remove_block(_requests(memory_name))
    remove_block(_samples(memory_name))


def _requests(memory_name: str) -> str:
    return f"{memory_name}-controller-requests"


def _samples(memory_name: str) -> str:
    return f"{memory_name}-controller-samples"
