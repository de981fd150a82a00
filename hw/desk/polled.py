"""A device that has to be asked: a thread of its own reads it, so that it can hold up no tick."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future

from hw.desk.desk_controller import DeskController, Reading
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError, TamsError
from tams_app.records import ControllerStatus, Haptic
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.runtime.mailbox import BoundedQueue, Mailbox
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_S
from tams_app.vectors import Floats3

POLL_RATE_HZ = 250
_START_TIMEOUT_S = 5.0
_AGAIN_NS = NS_PER_S // 2  # between two attempts to find a device that was unplugged
_WAITING_PULSES = 8


class PolledDevice(ABC):
    """A device; all of it is used by one thread."""

    title: str  # as people call it

    @abstractmethod
    def open(self) -> None:
        """DeviceError if there is none, in one sentence."""

    @abstractmethod
    def read(self) -> tuple[Deflection, int]:
        """Its state, and until when the device is known to be in it [ns], at most now.

        What was reported last stays readable when a device by radio has gone: its time must then
        stand still within `SILENT_NS` or, where reports cannot be told apart from silence,
        `DeskConfig.unchanged_ms`. Does not wait; DeviceError if the device has gone.
        """

    @abstractmethod
    def pulse(self, haptic: Haptic) -> None:
        """Let the hand feel something, if it can."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it; may be called twice."""


class PolledController(DeskController):
    """A polled device as a controller; one that is plugged in again goes on.

    `note` is called with level and text for every change, in the polling thread.
    """

    def __init__(
        self,
        device: PolledDevice,
        config: DeskConfig,
        rotation: tuple[Floats3, Floats3, Floats3],
        clock: Clock,
        note: Callable[[str, str], None],
    ) -> None:
        super().__init__(config, rotation)
        self._device, self._clock, self._note = device, clock, note
        self._readings: Mailbox[Reading | None] = Mailbox()
        self._pulses: BoundedQueue[Haptic] = BoundedQueue(_WAITING_PULSES)
        self._worker: Worker | None = None
        self._thread_name = f"{type(device).__name__.lower()}-poll"
        self._native_id: int | None = None
        self._told = ""  # why the device is not there

    def start(self) -> None:
        """Open the device; DeviceError if there is none."""
        self._pulses.take_all()
        opened: Future[None] = Future()
        worker = Worker(
            self._thread_name,
            lambda stop: self._run(opened, stop),
            lambda _, error: self._on_death(opened, error),
        )
        self._worker = worker
        worker.start()
        try:
            opened.result(_START_TIMEOUT_S)
        except TimeoutError as error:
            worker.request_stop()
            raise DeviceError(
                f"The {self._device.title} does not answer: unplug it, plug it in again."
            ) from error

    def reading(self) -> Reading | None:
        return self._readings.latest()

    def pulse(self, haptic: Haptic) -> None:
        if self._worker is not None:
            self._pulses.put(haptic)

    def close(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.stop()
        self._readings.put(None)

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        return {} if self._native_id is None else {self._thread_name: self._native_id}

    def _run(self, opened: Future[None], stop: threading.Event) -> None:
        self._native_id = threading.get_native_id()
        device = self._device
        try:
            device.open()
            self._read()
        except TamsError as error:
            device.close()
            opened.set_exception(error)
            return
        opened.set_result(None)
        try:
            rate = FixedRate(self._clock, POLL_RATE_HZ)
            again_ns = 0
            while not stop.is_set():
                rate.wait()
                again_ns = self._reopened(again_ns) if again_ns else self._polled()
        finally:
            device.close()
            self._readings.put(None)

    def _on_death(self, opened: Future[None], error: BaseException) -> None:
        """The thread has ended unasked: the controller is gone for good."""
        self._note("error", f"the {self._device.title} is read no more: {error!r}")
        if not opened.done():
            opened.set_exception(error)

    def _polled(self) -> int:
        """Read once; when to look for the device again [ns] if it has gone, else 0."""
        device = self._device
        try:
            self._read()
            for haptic in self._pulses.take_all():
                device.pulse(haptic)
        except DeviceError as error:
            self._tell(str(error))
            device.close()
            now_ns = self._clock.now_ns()
            self._readings.put(Reading(ControllerStatus.DISCONNECTED, now_ns))
            return now_ns + _AGAIN_NS
        return 0

    def _tell(self, sentence: str) -> None:
        """Once, until another one is true."""
        if sentence != self._told:
            self._told = sentence
            self._note("warning", sentence)

    def _reopened(self, again_ns: int) -> int:
        """Look for it when it is time to; 0 once it is there."""
        now_ns = self._clock.now_ns()
        if now_ns < again_ns:
            return again_ns
        try:
            self._device.open()
            self._read()
        except DeviceError as error:
            self._device.close()
            self._tell(str(error))
            return now_ns + _AGAIN_NS
        self._told = ""
        self._note("info", f"the {self._device.title} is there again")
        return 0

    def _read(self) -> None:
        deflection, known_ns = self._device.read()
        self._readings.put(Reading(ControllerStatus.OK, known_ns, deflection))


def beyond(dead_zone: float, *axes: float) -> tuple[float, ...]:
    """Axes of one stick or cap: zero within the dead zone, from there on evenly up to 1."""
    size = sum(axis * axis for axis in axes) ** 0.5
    if size <= dead_zone:
        return tuple(0.0 for _ in axes)
    wanted = min((size - dead_zone) / (1.0 - dead_zone), 1.0)
    return tuple(axis * wanted / size for axis in axes)
