"""What is asked of the arm outside the control loop because it waits for replies."""

from __future__ import annotations

import threading
from collections.abc import Callable

from hw.arm import Arm, ServoMode
from tams_app.errors import DeviceError
from tams_app.mailbox import BoundedQueue
from tams_app.teleop.safety import Request

_WAIT_S = 0.05


class ArmSupervisor:
    """Enables the arm and clears its errors when the arming logic asks; the body of a Worker.

    A stop outdates every request made before it: an ENABLE that was queued or under way when the
    arm was stopped never leaves it enabled. Only one ENABLE is queued or under way at a time.
    """

    def __init__(self, arm: Arm, servo: ServoMode, note: Callable[[str, str], None]) -> None:
        self._arm = arm
        self._servo = servo
        self._note = note
        self._requests: BoundedQueue[tuple[Request, int]] = BoundedQueue(4)
        self._lock = threading.Lock()
        self._stops = 0
        self._enabling = False
        self._ready = False

    @property
    def ready(self) -> bool:
        """The arm was enabled and nothing has stopped it since."""
        return self._ready

    def request(self, request: Request) -> None:
        """Queue a request; called by the control thread, does not block."""
        with self._lock:
            if request is Request.ENABLE:
                if self._enabling:
                    return
                self._enabling = True
            stops = self._stops
        self._requests.put((request, stops))

    def stopped(self) -> None:
        """A stop is sent: the arm must be enabled anew before it moves. From any thread."""
        with self._lock:
            self._stops += 1
            self._ready = False

    def run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            for request, stops in self._requests.take_all(_WAIT_S):
                self.carry_out(request, stops)

    def carry_out(self, request: Request, stops: int) -> None:
        """Do what was requested when `stops` stops had been sent."""
        try:
            if request is Request.ENABLE:
                self._enable(stops)
            elif request is Request.CLEAR_ERRORS:
                self._arm.clear_errors()
                self._note("info", "arm errors cleared")
        except DeviceError as error:
            self._note("error", str(error))

    def _enable(self, stops: int) -> None:
        try:
            if stops != self._stops:
                return
            self._arm.enable(self._servo)
            with self._lock:
                self._ready = stops == self._stops
            if self._ready:
                self._note("info", "arm enabled")
            else:
                self._arm.stop()
        finally:
            with self._lock:
                self._enabling = False
