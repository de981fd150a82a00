"""The one place of a session that enables the arm and sends the application's stops.

What waits for the arm's replies is done outside the control loop, by `run`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hw.arm import Arm, TcpBoundary
from tams_app.errors import DeviceError
from tams_app.records import TakeNote
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.teleop.safety import Request

GATE_TIMEOUT_S = 10.0  # of its end: enabling the arm may be under way
_WAIT_S = 0.05


class ArmGate:
    """Stops the arm, and enables it and clears its errors when the arming logic asks.

    A stop voids every earlier ENABLE: one queued or under way never leaves the arm enabled, and its
    refusal then is no error. CLEAR_ERRORS is still carried out. Beside those that are void only one
    ENABLE and one CLEAR_ERRORS are queued or under way at a time.
    An arm outside `boundary` is not enabled: its controller would end the first motion with an
    error.
    """

    def __init__(
        self,
        arm: Arm,
        boundary: TcpBoundary | None,
        note: TakeNote,
        enable: Callable[[], None] | None = None,
    ) -> None:
        """`enable`: what an ENABLE does in place of `Arm.enable`."""
        self._arm = arm
        self._make_ready = enable or arm.enable
        self._boundary = boundary
        self._note = note
        self._requests: BoundedQueue[tuple[Request, int]] = BoundedQueue(4)
        self._lock = threading.Lock()
        self._stops = 0
        self._pending: set[Request] = set()  # queued or under way
        self.ready = False  # the arm was enabled and nothing has stopped it since

    def request(self, request: Request) -> None:
        """Queue a request; called by the control thread, does not block."""
        with self._lock:
            if request in self._pending:
                return
            if self._requests.put((request, self._stops)):
                self._pending.add(request)

    def stop(self) -> None:
        """Stop the arm; it must be enabled anew before it moves. From any thread, never blocks."""
        with self._lock:
            self._stops += 1
            self.ready = False
            self._pending.discard(Request.ENABLE)  # outdated: the next one need not wait for it
        self._arm.stop()

    def run(self, stop: threading.Event) -> None:
        """Carry out requests until `stop` is set; the body of a Worker."""
        while not stop.is_set():
            self.serve(_WAIT_S)

    def serve(self, wait_s: float = 0.0) -> None:
        """Carry out what is queued, waiting up to `wait_s` for the first."""
        for request, stops in self._requests.take_all(wait_s):
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
            if not self._is_outdated(request, stops):
                self._note("error", str(error))
        finally:
            with self._lock:
                if not self._is_outdated(request, stops):
                    self._pending.discard(request)

    def _is_outdated(self, request: Request, stops: int) -> bool:
        return request is Request.ENABLE and stops != self._stops

    def _enable(self, stops: int) -> None:
        if stops != self._stops:
            return
        self._check_inside()
        self._make_ready()
        with self._lock:
            self.ready = stops == self._stops
        if self.ready:
            self._note("info", "arm enabled")
        else:
            self._arm.stop()

    def _check_inside(self) -> None:
        """DeviceError if the TCP is where the controller would not let it move."""
        state, boundary = self._arm.state(), self._boundary
        if state is None or boundary is None or boundary.contains(state.tcp.position):
            return  # without a report the control loop holds the arm
        x, y, z = (state.tcp.position * 1000.0).tolist()
        raise DeviceError(
            f"the TCP is at ({x:.0f}, {y:.0f}, {z:.0f}) mm, outside the workspace: "
            "run `run_tams.py home` first"
        )
