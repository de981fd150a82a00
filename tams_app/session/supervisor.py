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
    """Enables the arm and clears its errors when the arming logic asks; the body of a Worker."""

    def __init__(self, arm: Arm, servo: ServoMode, note: Callable[[str, str], None]) -> None:
        self._arm = arm
        self._servo = servo
        self._note = note
        self._requests: BoundedQueue[Request] = BoundedQueue(4)
        self._ready = threading.Event()

    @property
    def ready(self) -> bool:
        """The arm was enabled and nothing has stopped it since."""
        return self._ready.is_set()

    def request(self, request: Request) -> None:
        """Queue a request; called by the control thread, does not block."""
        self._requests.put(request)

    def stopped(self) -> None:
        """A stop was sent: the arm must be enabled again before it moves."""
        self._ready.clear()

    def run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            for request in self._requests.take_all(_WAIT_S):
                self._carry_out(request)

    def _carry_out(self, request: Request) -> None:
        try:
            if request is Request.ENABLE:
                self._arm.enable(self._servo)
                self._ready.set()
                self._note("info", "arm enabled")
            elif request is Request.CLEAR_ERRORS:
                self._ready.clear()
                self._arm.clear_errors()
                self._note("info", "arm errors cleared")
        except DeviceError as error:
            self._note("error", str(error))
