"""One rig per kind of controller: the simulated hand, here, published by another process and at the
other end of a link, the keyboard, and OpenVR's binding over a fake runtime.

A rig holds a controller whose trigger is pressed and whose hand is never quite still, lets time
pass, and makes the controller suffer what `SensorFault` names.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import openvr

from hw.controller import Controller
from hw.desk.keyboard import DEADMAN, HeldKeys, KeyboardController
from hw.link.controller import LinkController
from hw.openvr.controller import OpenVrController
from hw.remote_controller import ControllerPublisher, RemoteController
from hw.sim.operator.hand import Hand, HandCommand, ThumbButton
from tams_app.config import (
    ControllerConfig,
    DeskConfig,
    HandConfig,
    LinkConfig,
    OperatorConfig,
)
from tams_app.config.motion import FreshnessConfig
from tams_app.link.messages import HandMessage, decode, encode
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.runtime.shared_ring import new_block_name
from tams_app.station.operator_process import publish
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.contract.faulty_controller import FaultyController, SensorFault
from tests.hw.link.exchange import HOUR_NS, hand_message
from tests.hw.openvr.fake_openvr import RIGHT, SPARE, FakeDevice, FakeRuntime

TICK_NS = 8 * NS_PER_MS
FRESH_WITHIN_NS = round(FreshnessConfig().buttons_ms * NS_PER_MS)  # by the safety logic
_WITHIN_NS = 20 * NS_PER_S  # generous: the machine may be busy


def is_in_use(sample: ControllerSample) -> bool:
    """The deadman is held and known to be."""
    return sample.status is ControllerStatus.OK and sample.trigger == 1.0


def is_released(sample: ControllerSample) -> bool:
    """Nothing reads as pressed."""
    pressed = sample.a or sample.b or sample.menu
    return (sample.trigger, sample.grip, pressed) == (0.0, 0.0, False)


class ControllerRig(ABC):
    """A controller, the hand that holds it, and a way to let time pass.

    It is made with an `ExitStack`, which closes what it needs.
    """

    controller: Controller  # not started yet; its deadman is held from then on
    faults: frozenset[SensorFault] = frozenset(SensorFault)  # that can come over it
    can_be_felt = True

    @abstractmethod
    def advance(self) -> int:
        """Let one tick of about 8 ms pass; the time after it [ns], by the clock of the samples."""

    def sample(self) -> ControllerSample:
        """The sample of the next tick."""
        return self.controller.sample(self.advance())

    def until(self, holds: Callable[[ControllerSample], bool]) -> ControllerSample:
        """The first sample of which `holds` is true, which must come within 20 s."""
        deadline_ns = self.advance() + _WITHIN_NS
        while True:
            now_ns = self.advance()
            sample = self.controller.sample(now_ns)
            if holds(sample):
                return sample
            assert now_ns < deadline_ns, f"after {_WITHIN_NS // NS_PER_S} s still {sample}"

    @abstractmethod
    def tap(self) -> None:
        """The button that closes the gripper goes down and up between two ticks."""

    @abstractmethod
    def inject(self, fault: SensorFault | None) -> None:
        """From now on suffer `fault`; None ends it."""

    def fall_silent(self) -> None:
        """The device says nothing more, as when its radio dies, and who reads it is not told."""
        self.inject(SensorFault.FROZEN_POSE)

    @abstractmethod
    def felt(self) -> int:
        """How many vibrations have reached the hand."""


class _Holding:
    """In place of an operator: a person who holds the trigger and otherwise keeps still."""

    def __init__(self) -> None:
        self.hand = Hand(np.random.default_rng(0), 0.5)
        self.button: ThumbButton | None = None
        self.pulses = self.steps = 0
        self._last_ns: int | None = None

    def step(self, now_ns: int) -> None:
        self.steps += 1
        elapsed_ns = now_ns - (self._last_ns or now_ns)
        self._last_ns = now_ns
        self.hand.step(HandCommand.still(trigger=True, button=self.button), elapsed_ns / NS_PER_S)

    def feel(self, haptic: Haptic) -> None:
        self.pulses += 1


class HeldRig(ControllerRig):
    """A simulated hand that holds the controller `_hand`."""

    def __init__(self, cleaning: ExitStack) -> None:
        self._holding = _Holding()
        self._hand = FaultyController(self._holding, OperatorConfig(), seed=0)  # type: ignore[arg-type]

    def inject(self, fault: SensorFault | None) -> None:
        self._hand.inject(fault)

    def felt(self) -> int:
        return self._holding.pulses


class VirtualControllerRig(HeldRig):
    """Virtual time; passes only when asked."""

    def __init__(self, cleaning: ExitStack) -> None:
        super().__init__(cleaning)
        self._clock = VirtualClock()
        self.controller = self._hand

    def tap(self) -> None:
        self._holding.button = ThumbButton.A
        self.controller.sample(self._clock.now_ns())  # as the thread that reads the device
        self._holding.button = None

    def advance(self) -> int:
        self._clock.advance_ns(TICK_NS)
        return self._clock.now_ns()


class RemoteRig(HeldRig):
    """The driver of a controller that is published as by the operator's process, in real time."""

    def __init__(self, cleaning: ExitStack) -> None:
        super().__init__(cleaning)
        self._clock = MonotonicClock()
        name, stop = new_block_name(), threading.Event()
        self.controller = RemoteController(name, self._clock, runs=lambda: True)
        cleaning.callback(self.controller.let_go)
        publisher = ControllerPublisher(name, self._hand)
        cleaning.callback(publisher.close)
        thread = threading.Thread(target=publish, args=(publisher, self._clock, stop))
        thread.start()
        cleaning.callback(thread.join)
        cleaning.callback(stop.set)

    def tap(self) -> None:
        self._holding.button = ThumbButton.A
        read = self._holding.steps + 5
        while self._holding.steps < read:  # the other process reads it; no sample is taken
            time.sleep(TICK_NS / NS_PER_S)
        self._holding.button = None

    def advance(self) -> int:
        time.sleep(TICK_NS / NS_PER_S)
        return self._clock.now_ns()


class LinkRig(HeldRig):
    """A simulated hand at another computer, whose clock is another; virtual time.

    Each tick a message leaves, and the one before arrives.
    """

    _OFFSET_NS = 3 * HOUR_NS

    def __init__(self, cleaning: ExitStack) -> None:
        super().__init__(cleaning)
        self._clock = VirtualClock()
        self._hand.start()
        self._on_its_way: bytes | None = None
        self._arrived: tuple[int, bytes] | None = None
        self.controller = self._link = LinkController(LinkConfig(), self._receive, self._hand.pulse)

    def tap(self) -> None:
        self._holding.button = ThumbButton.A
        self._hand.sample(self._clock.now_ns() + self._OFFSET_NS)  # its message is lost
        self._holding.button = None

    def advance(self) -> int:
        echo_ns = self._clock.now_ns()
        self._clock.advance_ns(TICK_NS)
        now_ns = self._clock.now_ns()
        if self._on_its_way is not None:
            self._arrived = (now_ns, self._on_its_way)
        sent_ns = now_ns + self._OFFSET_NS
        sample = self._hand.sample(sent_ns)
        self._on_its_way = encode(hand_message(sample, sent_ns, echo_ns))
        return now_ns

    def _receive(self, now_ns: int) -> None:
        arrived, self._arrived = self._arrived, None
        if arrived is not None:
            heard_ns, content = arrived
            self._link.take(decode(content, HandMessage), heard_ns)


class KeyboardRig(ControllerRig):
    """The console's window tells which keys are held; virtual time."""

    faults = frozenset({SensorFault.STANDBY})  # the window loses the focus
    can_be_felt = False

    def __init__(self, cleaning: ExitStack) -> None:
        self._clock = VirtualClock()
        self._clock.advance_ns(NS_PER_S)
        self._focused, self._tells = True, True
        self._presses: dict[str, int] = {}
        self._keyboard = KeyboardController(DeskConfig(), HandConfig().rotation)
        self.controller = self._keyboard

    def tap(self) -> None:
        self._presses["c"] = self._presses.get("c", 0) + 1

    def inject(self, fault: SensorFault | None) -> None:
        self._focused = fault is None

    def advance(self) -> int:
        self._clock.advance_ns(TICK_NS)
        now_ns = self._clock.now_ns()
        if self._tells:
            keys = frozenset({DEADMAN, "w"})
            self._keyboard.feed(HeldKeys(keys, self._focused, now_ns, dict(self._presses)))
        return now_ns

    def fall_silent(self) -> None:
        self._tells = False

    def felt(self) -> int:
        return 0


class OpenVrRig(ControllerRig):
    """The real driver and binding over a fake runtime, in real time."""

    def __init__(self, cleaning: ExitStack) -> None:
        self.runtime = FakeRuntime()
        cleaning.enter_context(self.runtime.in_place_of_the_library())
        self._clock = MonotonicClock()
        self.runtime.devices[RIGHT].trembles = True
        self.runtime.press("trigger")
        self.controller = OpenVrController(ControllerConfig(), self._clock, lambda *_: None)
        cleaning.callback(self.controller.close)

    def tap(self) -> None:
        for value in (1.0, 0.0):
            self.runtime.press("a", value)
            self.runtime.await_reading()

    def inject(self, fault: SensorFault | None) -> None:
        hand = self.runtime.devices[RIGHT]
        match fault:
            case SensorFault.TRACKING_LOST:
                hand.valid = False
            case SensorFault.STANDBY:
                hand.activity = openvr.k_EDeviceActivityLevel_Standby
            case SensorFault.DASHBOARD:
                self.runtime.dashboard = True
            case SensorFault.DISCONNECTED:
                hand.connected = False
            case SensorFault.RUNTIME_QUIT:
                self.runtime.quit()
            case SensorFault.ROLE_SWAPPED:
                self.runtime.devices[SPARE] = FakeDevice("CTL_SPARE")
                self.runtime.give_hand_to(SPARE)
            case SensorFault.TRACKING_FRAME_CHANGED:
                self.runtime.recentre()
            case SensorFault.FROZEN_POSE:
                hand.trembles = False
            case SensorFault.FROZEN_BUTTONS:
                self.runtime.bound.remove("trigger")
            case None:
                self._recover()

    def advance(self) -> int:
        time.sleep(TICK_NS / NS_PER_S)
        return self._clock.now_ns()

    def felt(self) -> int:
        return len(self.runtime.vibrations)

    def _recover(self) -> None:
        hand = self.runtime.devices[RIGHT]
        hand.activity = openvr.k_EDeviceActivityLevel_UserInteraction
        hand.trembles = True
        self.runtime.dashboard = False
        self.runtime.bound.add("trigger")
        self.runtime.give_hand_to(RIGHT)
        self.runtime.restart()
        self._let_go_for_a_second()

    def _let_go_for_a_second(self) -> None:
        """After a recentring this alone makes the controller count again."""
        if self.controller.sample(0).status is ControllerStatus.TRACKING_FRAME_CHANGED:
            self.runtime.press("trigger", 0.0)
            self.until(lambda sample: sample.status is ControllerStatus.OK)
            self.runtime.press("trigger")
